"""Playing episodes: returns of one policy, of many programs at once, and the checks of domains."""
