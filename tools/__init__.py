"""Small programs that keep the repository in order; `make help` says which target runs which."""
