"""The errors that are told in one line: bad input or bad usage, and a job that failed through no fault of its input."""


class InputError(ValueError):
    """Input or usage that cannot be used as it is.

    The message names the thing, what was expected and what came. The command line prints it alone, without a
    traceback, and exits with status 2.
    """


class JobError(RuntimeError):
    """A job that could not be done though its input is right: the device or a worker was lost, or memory lacks.

    The message says what happened and how to go on. The command line prints it alone and exits with status 1.
    """
