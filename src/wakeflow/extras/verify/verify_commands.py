"""extras/verify/verify_commands.py."""
