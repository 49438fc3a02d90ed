"""Records with a broad spectrum: frequency responses, and the poles in them."""
