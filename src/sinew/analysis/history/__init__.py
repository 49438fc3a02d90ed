"""Many runs over months: an index of them, its search, what has changed, and how two of them differ."""
