"""The types of result.json, its reader and writer, and the numbers of results as tables."""
