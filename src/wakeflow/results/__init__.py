"""The answer and its error: shares of every bin, companions flown with one thing changed, the budget."""
