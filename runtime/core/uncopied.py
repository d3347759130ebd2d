"""Objects that own memory and machine code of this process."""

from __future__ import annotations

from typing import Never


class Uncopied:
    """Can neither be copied nor pickled: a copy would use memory that is freed with the original."""

    def __reduce_ex__(self, protocol: object) -> Never:
        raise TypeError(
            f"a {type(self).__name__} can't be copied or pickled: it owns memory and machine code of this process; "
            "make another one instead"
        )
