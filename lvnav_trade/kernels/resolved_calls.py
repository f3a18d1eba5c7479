"""Cache of resolved calls, to shorten compilation.

At every call and in every pass over a function, numba searches the dozens of implementations of an operator for the one
that fits the argument types, and formats a message for each that does not fit.
"""

from typing import Any

from numba import types
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack
from numba.core.typing import Context


class CachingContext(Context):  # type: ignore[misc]  # numba publishes no types
    """Numba's typing context with a cache of resolved calls.

    If numba learns of another implementation, the function type is a new object, so a cached result is never outdated.
    """

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a call for given argument types."""
        function_type = func if isinstance(func, types.Type) else self._lookup_global(func)
        if not isinstance(function_type, types.Function) or kws:
            return super().resolve_function_type(func, args, kws)
        key = (id(function_type), tuple(args), self._options())
        if key not in self.signatures:
            signature = super().resolve_function_type(function_type, args, kws)
            if signature is None or signature.args not in function_type._impl_keys:
                return signature
            # the function type is stored too, so that its id stays unique
            self.signatures[key] = (function_type, signature, function_type._impl_keys[signature.args])
        _, signature, implementation = self.signatures[key]
        function_type._impl_keys[signature.args] = implementation
        return signature

    def _options(self) -> int:
        """Return a number for the options of the present compilation, on which the resolution may depend."""
        flags = ConfigStack.top_or_none()
        if flags is not self.last_options[0]:
            self.last_options = (flags, self.option_numbers.setdefault(flags, len(self.option_numbers)))
        return self.last_options[1]

    signatures: dict[Any, Any]
    option_numbers: dict[Any, int]
    last_options: tuple[Any, int]


def install_call_cache() -> None:
    """Install the cache of resolved calls in numba, for this process."""
    context = cpu_target.typing_context
    context.signatures, context.option_numbers, context.last_options = {}, {None: 0}, (None, 0)
    context.__class__ = CachingContext
