"""This is where what the pages of the dashboard show is computed: plain functions, JSON in and out."""
