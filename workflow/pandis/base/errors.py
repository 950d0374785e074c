"""The two kinds of error that users see."""


class PandisError(Exception):
    """Something outside the code is wrong; the message says what, where and what to do.

    A stage that fails with it prints only the message. Any other exception
    is a defect of pandis, and its traceback is printed.
    """


class ArtifactError(PandisError):
    """An artifact is missing, damaged or of another kind than its reader expects."""
