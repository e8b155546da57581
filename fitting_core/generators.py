"""Generators that return a value: run to their end, or passed on with each of their values changed."""

from collections.abc import Callable, Generator
from typing import Any, TypeVar

Value = TypeVar("Value")
Other = TypeVar("Other")
Returned = TypeVar("Returned")


def drained(generator: Generator[Any, None, Returned]) -> Returned:
    """What a generator returns; what it yields is left aside."""
    while True:
        try:
            next(generator)
        except StopIteration as stop:
            return stop.value


def mapped(
    generator: Generator[Value, None, Returned], change: Callable[[Value], Other]
) -> Generator[Other, None, Returned]:
    """The same generator with `change` of each of its values; closing it closes the other one."""
    try:
        while True:
            try:
                value = next(generator)
            except StopIteration as stop:
                return stop.value
            yield change(value)
    finally:
        generator.close()
