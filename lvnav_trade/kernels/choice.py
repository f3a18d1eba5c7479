"""Kernels that call one of several kernels by its number, written from a list."""

import inspect
import textwrap
from collections.abc import Callable, Iterable
from typing import Any

_TEXT = "__text__"


def source_of(function: Callable[..., Any]) -> str:
    """Return the source of a function: as it stands in its file, or as `choosing` wrote it."""
    return getattr(function, _TEXT, "") or inspect.getsource(function)


def choosing(kernels: Iterable[Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a function that has a docstring only its body: it calls the kernel whose number is its argument `code`.

    kernels: in the order of their numbers, None for one that does nothing. Each takes some of the arguments of the
    function, and names them alike. The compiler, and the translator to C, see a plain chain of tests. TypeError names a
    kernel that asks for another argument.
    """
    numbers: dict[Any, list[int]] = {}
    for number, kernel in enumerate(kernels):
        if kernel is not None:
            numbers.setdefault(kernel, []).append(number)

    def written(function: Callable[..., Any]) -> Callable[..., Any]:
        given = list(inspect.signature(function).parameters)
        lines, called = list[str](), dict[str, Any]()
        for kernel, own in numbers.items():
            label = _label(kernel, called)
            called[label] = kernel
            tests = " or ".join(f"code == {number}" for number in own)
            lines += [f"{'elif' if lines else 'if'} {tests}:", f"    {label}({', '.join(_asked(kernel, given))})"]
        text = f"def {function.__name__}({', '.join(given)}):\n" + textwrap.indent("\n".join(lines or ["pass"]), "    ")
        namespace = {"__name__": function.__module__, **called}
        exec(compile(text, function.__code__.co_filename, "exec"), namespace)
        made: Any = namespace[function.__name__]
        made.__code__ = made.__code__.replace(co_firstlineno=function.__code__.co_firstlineno)
        made.__doc__ = function.__doc__
        setattr(made, _TEXT, f"{text}\n")
        return made

    return written


def _asked(kernel: Any, given: list[str]) -> list[str]:
    """Return the arguments that a kernel takes, by name."""
    python = getattr(kernel, "py_func", kernel)
    asked = list(inspect.signature(python).parameters)
    if unknown := [name for name in asked if name not in given]:
        place = f"{python.__module__}.{python.__name__}"
        raise TypeError(f"{place} asks for {', '.join(unknown)}; there is {', '.join(given)}")
    return asked


def _label(kernel: Any, taken: Iterable[str]) -> str:
    """Return a name for a kernel that none of those taken has: its module's and its own."""
    python = getattr(kernel, "py_func", kernel)
    label = f"{python.__module__.rpartition('.')[2]}_{python.__name__}"
    return label if label not in taken else f"{label}_{sum(name.startswith(label) for name in taken) + 1}"
