"""This is where the small programs live that keep the repository in order; `make help` says which target runs which."""
