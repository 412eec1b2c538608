"""A question to a policy is valid exactly where its documented schema says so."""

from __future__ import annotations

from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from zengrid_gateway.policies import ROWS, PolicyQuestion

schema = jsonschema.Draft202012Validator(PolicyQuestion.model_json_schema())

numbers = (
    st.integers(-(10**9) - 1, 10**9 + 1)
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.sampled_from([10**400, 2**63, 2**64, 1e9 + 2e-7])
    | st.booleans()
)
leaves = numbers | st.none() | st.text(max_size=3) | st.lists(numbers, max_size=3)
quantities = st.none() | leaves | st.dictionaries(st.text(max_size=3), leaves, max_size=3)
rows = leaves | st.lists(leaves, max_size=3)
questions = leaves | st.fixed_dictionaries(
    {}, optional={"quantities": quantities, "observations": rows, "home": leaves, "other": leaves}
)


def accepted(question: Any) -> bool:
    try:
        PolicyQuestion.model_validate(question)
    except ValidationError:
        return False
    return True


@given(questions)
def test_the_schema_says_what_is_accepted(question: Any) -> None:
    assert accepted(question) == schema.is_valid(question)


@pytest.mark.parametrize("length", [0, 1, ROWS, ROWS + 1])
@pytest.mark.parametrize("question", ["quantities", "observations"])
def test_lists_have_one_documented_length(question: str, length: int) -> None:
    asked = {"quantities": {"soc": [0.5] * length}} if question == "quantities" else {"observations": [[0.5]] * length}
    assert accepted(asked) == schema.is_valid(asked) == (1 <= length <= ROWS)
