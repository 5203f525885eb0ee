"""What is built upon the rooms and may be left away: each folder or module here is one extra.

Comes in: what the rooms make. Goes out: commands, and entries of the rooms' registries.
May call it: the rooms by registration alone (core.registry). An extra imports rooms and other extras, no room an extra.
"""
