"""This is where the nouns live: recordings, results, estimates, units, files and the error tree."""
