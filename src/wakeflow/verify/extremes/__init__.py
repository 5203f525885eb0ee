"""The stability matrix: scenes and flights at the ends of what can be asked for, each judged."""
