"""Controllers: policies and their files, hand-written and planning controllers."""
