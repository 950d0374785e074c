"""The two kinds of error that users see."""


class PandisError(Exception):
    """A fault outside the code; the message states what is wrong, where, and what to do.

    A stage that fails with it prints only the message. Any other exception
    is a defect of pandis, and its traceback is printed.
    """


class ArtifactError(PandisError):
    """An artifact is missing, damaged or of a kind that its reader does not expect."""
