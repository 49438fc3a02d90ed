"""Pages of the dashboard, each with its layout."""
