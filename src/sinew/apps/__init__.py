"""The command line, its documents, and the dashboard."""
