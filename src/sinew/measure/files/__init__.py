"""File formats, one module each: what is read from them and written into them."""
