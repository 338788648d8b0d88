"""Scene keys: the unit and meaning of each, and families of which a scene chooses one kind by a key."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from inspect import get_annotations
from operator import or_
from typing import Annotated, Any, ClassVar

from pydantic import Discriminator


@dataclass(frozen=True)
class Key:
    """Unit and meaning of a scene key; `workflows/SCENE.md` is generated from these."""

    unit: str
    meaning: str


class Noun:
    """Base of the frozen dataclasses that a scene is made of; keys that are no fields are refused."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}


class Choice(Noun):
    """Base of a family of kinds, of which a scene chooses one by a literal key (`builder`, `shape`, `law`).

    A direct subclass is the family. A subclass of the family that declares the key as a field is a kind, and its
    definition registers it. A subclass that does not declare the key is a base that several kinds share.
    """

    tag: ClassVar[str]  # name of the key
    kinds: ClassVar[list[type[Any]]]  # filled by the definitions of the kinds

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if Choice in cls.__bases__:
            cls.kinds = []
        elif cls.tag in get_annotations(cls):
            cls.kinds.append(cls)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Callable[[Any], Any]) -> Any:
        if Choice not in cls.__bases__:
            return handler(source)
        if len(cls.kinds) == 1:
            return handler(cls.kinds[0])
        any_kind = reduce(or_, cls.kinds)
        return handler.generate_schema(Annotated[any_kind, Discriminator(cls.tag)])  # type: ignore[attr-defined]
