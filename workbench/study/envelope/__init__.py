"""The envelope of a study: parameters with distributions, failures, maps, the worst case, probabilities."""
