"""What a call was found to be is remembered.

Numba asks again at every place, and at every pass over a function, which of the dozens of functions behind a plus or an
index fits the types of the arguments, and writes a message for each that does not.
"""

from typing import Any

from numba import types
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack
from numba.core.typing import Context


class RememberingContext(Context):  # type: ignore[misc]  # numba tells no types
    """Numba's knowledge of types, which keeps its answers.

    A function that numba learns more about is another object, so no answer outlives what it was based on.
    """

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a call of a function with types of arguments."""
        known = func if isinstance(func, types.Type) else self._lookup_global(func)
        if not isinstance(known, types.Function) or kws:
            return super().resolve_function_type(func, args, kws)
        key = (id(known), tuple(args), self._options())
        if key not in self.answers:
            found = super().resolve_function_type(known, args, kws)
            if found is None or found.args not in known._impl_keys:
                return found
            self.answers[key] = (known, found, known._impl_keys[found.args])  # kept, so that its id is not used again
        _, found, implementation = self.answers[key]
        known._impl_keys[found.args] = implementation
        return found

    def _options(self) -> int:
        """Return a number for the options of the compilation under way: some decide what a call is."""
        flags = ConfigStack.top_or_none()
        if flags is not self.asked[0]:
            self.asked = (flags, self.numbers.setdefault(flags, len(self.numbers)))
        return self.asked[1]

    answers: dict[Any, Any]
    numbers: dict[Any, int]
    asked: tuple[Any, int]


def remember() -> None:
    """Let numba remember, in this process."""
    context = cpu_target.typing_context
    context.answers, context.numbers, context.asked = {}, {None: 0}, (None, 0)
    context.__class__ = RememberingContext
