"""What is kept of a run: samples, the journal while it goes on, and the recording that it becomes."""
