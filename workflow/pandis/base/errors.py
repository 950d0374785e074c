"""The two kinds of error a user is meant to read."""


class PandisError(Exception):
    """Something outside the code is wrong; the message says what, where and what to do.

    A stage that ends with one prints its message as a plain sentence. Any
    other exception is a defect of pandis and prints its traceback.
    """


class ArtifactError(PandisError):
    """An artifact is missing, damaged or of another kind than its reader expects."""
