"""This is where the command line live."""
