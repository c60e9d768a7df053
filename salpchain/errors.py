"""The error that users see as one line."""


class InputError(ValueError):
    """Something that a user gave is wrong: the message says what, what was given and what is right.

    The command line prints it as one line and exits with status 2.
    """

    def __init__(self, message: object = "", *, python: str = "", shell: str = "") -> None:
        """The message may end with what to do: in Python, or else on the command line."""
        super().__init__(f"{message}{python}")
        self.typed = f"{message}{shell}"  # what the command line prints
