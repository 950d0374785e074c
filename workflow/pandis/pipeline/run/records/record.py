"""Records: the attributes of an artifact as named fields.

A record is written by one stage and read by others. Its class is the only place that names its
fields.
"""

from pydantic import BaseModel, ConfigDict, ValidationError

from pandis.base.errors import ArtifactError


class Record(BaseModel):
    """Base of all records. Attributes that are not fields are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    @classmethod
    def of(cls, artifact):
        """Return the record in the attributes of a `pandis.pipeline.run.job.artifact.Artifact`.

        Raises
        ------
        ArtifactError
            Another version of pandis wrote the attributes.
        """
        return cls.checked(artifact, artifact.attributes)

    @classmethod
    def checked(cls, artifact, values):
        """Return the record in ``values``, which are part of an artifact's attributes."""
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise ArtifactError(
                f"{artifact.path}: made by another version of pandis ({error.error_count()} "
                "attributes are missing or have the wrong type); run the workflow again"
            ) from error

    def attributes(self):
        """Return the record as plain attributes."""
        return self.model_dump()
