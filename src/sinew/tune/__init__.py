"""This is where Sinew tunes a joint and keeps it tuned: it holds a resonance, and moves it to where it is wanted."""
