"""Words of the command line: numbers by key, and errors of the library that name the option typed."""

from __future__ import annotations

import pytest

from workbench.cli.options import keyed_number
from workbench.core.errors import InputError


def test_a_word_of_key_and_number_is_read_and_any_other_is_one_line():
    assert keyed_number(" guide.coulomb_hoisting_n = 9e3", "limits") == ("guide.coulomb_hoisting_n", 9000.0)
    assert keyed_number("heave.amplitude_m=-0.2", "effect", "NAME.PARAMETER=VALUE", parts=2)[1] == -0.2
    for word, parts in [("heavy", 1), ("=3", 1), ("a=nan", 1), ("a=3", 2), ("a.=3", 2), (".b=3", 2), ("a.b=x", 2)]:
        with pytest.raises(InputError, match=f"^limits: '{word}', expected KEY=VALUE$"):
            keyed_number(word, "limits", parts=parts)
