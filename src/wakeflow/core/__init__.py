"""The machine: files and the cache, outside programs, errors, registries, plane geometry. Knows nothing of granules."""
