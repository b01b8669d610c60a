"""For the API pages: a setting's default and description in the place of its `Field(...)`."""

import ast
from typing import Any

from griffe import Attribute, Docstring, Expr, ExprCall, ExprKeyword, Extension


class SettingsFields(Extension):
    """Reads `name: type = Field(default, ..., description="...")`."""

    def on_attribute_instance(self, *, attr: Attribute, **_: Any) -> None:
        """griffe's event: an attribute was read."""
        call = attr.value
        if not isinstance(call, ExprCall) or str(call.function) != "Field":
            return
        words = {one.name: one.value for one in call.arguments if isinstance(one, ExprKeyword)}
        places: list[str | Expr] = [one for one in call.arguments if not isinstance(one, ExprKeyword)]
        if "description" in words and attr.docstring is None:
            # one string or several side by side
            text = ast.literal_eval(str(words["description"]))
            attr.docstring = Docstring(str(text), parent=attr)
        factory = words.get("default_factory")
        attr.value = places[0] if places else words.get("default", factory and f"{factory}()")
