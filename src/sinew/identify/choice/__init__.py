"""Which law a record speaks for, and what it cannot tell."""
