"""The one exception root of the project."""


class HighFiveError(Exception):
    """Something a user can put right.

    The message says, in one line, what was got, what was expected and what to do. The command line prints it without a
    traceback and exits with code 2.
    """
