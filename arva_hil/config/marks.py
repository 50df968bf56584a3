"""What a declaration says of a key besides its sort: its help, since which spec it is, that it is no key at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue
    from pydantic_core import CoreSchema


@dataclass(frozen=True)
class Help:
    """What a key means, in a few words."""

    text: str

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(schema) | {"description": self.text}


@dataclass(frozen=True)
class Since:
    """The key is one of files of this `spec` and newer ones."""

    spec: int


class NotAKey:
    """A field of the object that is no key of the file."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        from pydantic_core import PydanticOmit  # slow to import

        raise PydanticOmit
