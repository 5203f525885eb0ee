"""extras/search/search_commands.py."""
