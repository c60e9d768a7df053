"""How good it can be: fixed starts, and for each the swim with the fewest steps that is known."""
