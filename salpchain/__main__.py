"""`python -m salpchain` is the command line."""

from salpchain.cli.main import main

main()
