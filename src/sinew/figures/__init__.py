"""This is where the pictures of the paper and the report live."""
