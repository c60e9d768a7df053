"""Controllers: graph networks, the layers they are made of, and a hand-written baseline."""
