"""The one error that is the user's to mend: bad input or bad usage, told in one line."""


class InputError(ValueError):
    """Input or usage that cannot be used as it is.

    The message names the thing, what was expected and what came. The command line prints it alone, without a
    traceback, and exits with status 2.
    """
