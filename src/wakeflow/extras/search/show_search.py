"""extras/search/show_search.py."""
