"""extras/page/page_commands.py."""
