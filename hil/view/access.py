"""Who may open the page: who has the key, from an address that is ours, through a page that is ours."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field
from urllib.parse import SplitResult, parse_qs, urlsplit

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
"""Names of this machine as a browser on it writes them."""

_MOST_FIELDS = 8  # of a query


def address_of(target: str) -> SplitResult | None:
    """What a request asks for, in its parts; None where that is no address."""
    try:
        return urlsplit(target)
    except ValueError:
        return None


def new_key() -> str:
    """A key of 128 random bits."""
    return secrets.token_urlsafe(16)


@dataclass(frozen=True)
class Access:
    """What a request is checked against.

    Attributes:
        key: in the address that is printed.
        hosts: names and ports under which the page may be asked for (against DNS rebinding).
        secure: it is served over TLS.
    """

    key: str = field(repr=False)
    hosts: frozenset[str]
    secure: bool = False

    @classmethod
    def to(cls, port: int, key: str, names: Iterable[str] = (), *, secure: bool = False) -> Access:
        """To this machine, and to it under other ``names``."""
        return cls(key, frozenset(f"{name}:{port}" for name in (*LOOPBACK, *names)), secure)

    def refusal(self, query: str, host: str | None, origin: str | None, *, needs_key: bool) -> str:
        """Why a request is refused, in one line; nothing where it is not.

        Args:
            query: of the address.
            host: the header ``Host``.
            origin: the header ``Origin``; a program that is no browser sends none.
            needs_key: the key is asked for.
        """
        if host is None or host.lower() not in self.hosts:
            return "this address is not the one that High Five serves"
        if origin is not None and origin.lower() not in self._origins:
            return "pages of other sites may not look at High Five"
        if not needs_key:
            return ""
        try:
            keys = parse_qs(query, max_num_fields=_MOST_FIELDS).get("key", [])
        except ValueError:  # too many
            keys = []
        # Bytes that are no ASCII come as surrogates, in which no key is written.
        if len(keys) == 1 and hmac.compare_digest(keys[0].encode(errors="replace"), self.key.encode()):
            return ""
        return "the key in this address is missing or wrong: open the address that High Five printed"

    @property
    def _origins(self) -> set[str]:
        return {f"{'https' if self.secure else 'http'}://{host}" for host in self.hosts}
