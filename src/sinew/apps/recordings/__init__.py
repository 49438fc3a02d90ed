"""Commands that make a recording, or read one."""
