"""What a scene key says about itself: its unit and meaning, and how one of several kinds is chosen."""

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
    """Base of the frozen dataclasses that a scene is made of: unknown keys are refused."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}


class Choice(Noun):
    """Base of a family told apart by one literal key (`builder`, `shape`, `law`).

    A direct subclass is the family; each subclass of it that declares the key is a kind, and defining it is all that
    registers it. One that does not is what some kinds share.
    """

    tag: ClassVar[str]
    kinds: ClassVar[list[type[Any]]]

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
