"""The error that users see as one line."""


class InputError(ValueError):
    """Something that a user gave is wrong: the message says what, what was given and what is right.

    The command line prints it as one line and exits with status 2.
    """
