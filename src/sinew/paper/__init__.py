"""What is about the one paper that Sinew implements: its numbers, open questions and report."""
