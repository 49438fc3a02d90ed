"""The nouns of Sinew: recordings, results, estimates, units, files and the error tree."""
