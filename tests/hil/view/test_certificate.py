"""The page over TLS: a certificate that is made once, good for its names, and made anew where it is not."""

import json
import ssl
import stat
from datetime import timedelta
from http import HTTPStatus
from http.client import HTTPSConnection
from pathlib import Path

import pytest
from websockets.sync.client import connect

from highfive.hil.view import certificate as module
from highfive.hil.view.certificate import certificate, certificate_folder
from highfive.hil.view.live_page import LivePage
from highfive.model.errors import HighFiveError

NAMES = ("192.0.2.7", "lab.example")


def test_it_is_made_once_and_anew_where_it_is_no_good(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    public, secret = certificate(NAMES, tmp_path / "new")
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    first = public.read_bytes(), secret.read_bytes()
    assert certificate(NAMES[:1], tmp_path / "new") == (public, secret)
    assert (public.read_bytes(), secret.read_bytes()) == first
    certificate(("192.0.2.8",), tmp_path / "new")  # another name
    second = public.read_bytes()
    assert second != first[0]
    secret.write_bytes(first[1])  # a key of another certificate
    certificate(("192.0.2.8",), tmp_path / "new")
    assert public.read_bytes() != second
    public.write_bytes(public.read_bytes()[:100])
    certificate(("192.0.2.8",), tmp_path / "new")
    assert b"END CERTIFICATE" in public.read_bytes()
    monkeypatch.setattr(module, "LASTS", timedelta(days=3))
    for path in (public, secret):
        path.unlink()
    certificate(NAMES, tmp_path / "new")
    third = public.read_bytes()
    certificate(NAMES, tmp_path / "new")
    assert public.read_bytes() != third, "it ends within a week"


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(HighFiveError, match="cannot write the page's certificate into"):
        certificate(NAMES, tmp_path / "file" / "folder")


def test_it_is_kept_in_the_users_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert certificate_folder() == tmp_path / "highfive"


@pytest.mark.slow
def test_the_page_is_served_over_tls_and_not_without(tmp_path: Path) -> None:
    files = certificate((), tmp_path)
    trusting = ssl.create_default_context(cafile=str(files[0]))
    with LivePage({"mode": "session"}, port=0, tls=files) as page:
        assert page.address.startswith("https://localhost:")
        live = page.address.replace("https", "wss", 1).replace("/?", "/live?")
        origin = f"https://localhost:{page.port}"
        with connect(live, ssl=trusting, origin=origin) as link:  # pyright: ignore[reportArgumentType]
            assert json.loads(link.recv(5.0))["kind"] == "hello"
        # By a plain client: the one of websockets can lose a refusal over TLS to the end of the stream behind it.
        asked = HTTPSConnection("localhost", page.port, context=trusting, timeout=10.0)
        asked.request("GET", live.partition(str(page.port))[2], headers={"Origin": f"http://localhost:{page.port}"})
        assert asked.getresponse().status == HTTPStatus.FORBIDDEN
        asked.close()
        with pytest.raises(ssl.SSLCertVerificationError):
            connect(live, ssl=ssl.create_default_context()).__enter__()
        with pytest.raises(Exception, match=r".") as plain:
            connect(live.replace("wss", "ws"), open_timeout=5).__enter__()
        assert not isinstance(plain.value, AssertionError)
