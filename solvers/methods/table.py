"""Which method works with what: yes, or refused with one line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Applicability:
    """What a method needs of a scene, and when to use it."""

    floating: bool  # works while a body is held by contact and friction alone
    use: str


METHODS: Mapping[str, Applicability] = {
    "auto": Applicability(floating=True, use="condensed-newton"),
    "condensed-newton": Applicability(floating=True, use="the default: few iterations, hard to break"),
    "uzawa": Applicability(floating=False, use="the classical iteration: simple, many cheap iterations"),
}
