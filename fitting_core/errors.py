"""The one exception for what a user gave: files, options, clips."""


class InputError(ValueError):
    """Something that the user gave cannot be used.

    The message says what was found, what was expected and what to do. The command line prints it without a
    traceback; a caller of the library catches it as a ValueError.
    """
