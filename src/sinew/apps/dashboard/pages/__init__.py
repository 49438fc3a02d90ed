"""This is where each page of the dashboard is laid out."""
