"""A stand-in of S3 for tests: one bucket in memory, and of the protocol what is used (put, get, list, delete)."""

import contextlib
import threading
from collections.abc import Iterator
from email.utils import formatdate
from hashlib import md5
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, unquote, urlsplit
from xml.etree import ElementTree
from xml.sax.saxutils import escape

PAGE = 3  # names in an answer to a list, which has further pages


class FakeS3(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    objects: dict[str, bytes]

    def log_message(self, *_: object) -> None:
        """Nothing."""

    def _answer(self, status: int, body: bytes = b"", **headers: str) -> None:
        self.send_response(status)
        for name, value in {"Content-Length": str(len(body)), **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(body)

    def _asked(self) -> tuple[str, dict[str, list[str]], bytes]:
        url = urlsplit(self.path)
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        assert "AWS4-HMAC-SHA256 Credential=key/" in self.headers["Authorization"]
        return unquote(url.path).removeprefix("/bucket").strip("/"), parse_qs(url.query, keep_blank_values=True), body

    def do_PUT(self) -> None:
        key, _, body = self._asked()
        self.objects[key] = body
        self._answer(200, ETag=f'"{md5(body).hexdigest()}"')

    def do_GET(self) -> None:
        key, query, _ = self._asked()
        if "list-type" in query:
            prefix, after = query.get("prefix", [""])[0], query.get("continuation-token", [""])[0]
            names = sorted(name for name in self.objects if name.startswith(prefix) and name > after)
            more = len(names) > PAGE
            when = "<LastModified>2026-01-01T00:00:00.000Z</LastModified><ETag>x</ETag>"
            rows = "".join(f"<Contents><Key>{escape(name)}</Key>{when}<Size>{len(self.objects[name])}</Size></Contents>"
                           for name in names[:PAGE])  # fmt: skip
            token = f"<NextContinuationToken>{escape(names[PAGE - 1])}</NextContinuationToken>" if more else ""
            text = f"<ListBucketResult><IsTruncated>{str(more).lower()}</IsTruncated>{token}{rows}</ListBucketResult>"
            self._answer(200, text.encode())
        elif key in self.objects:
            body = self.objects[key]
            self._answer(200, body, ETag=f'"{md5(body).hexdigest()}"', Last_Modified=formatdate(0, usegmt=True))
        else:
            self._answer(404, b"<Error><Code>NoSuchKey</Code></Error>")

    def do_POST(self) -> None:
        _, query, body = self._asked()
        assert "delete" in query
        keys = [each.text or "" for each in ElementTree.fromstring(body).iter() if each.tag.rpartition("}")[2] == "Key"]
        for key in keys:
            self.objects.pop(key, None)
        rows = "".join(f"<Deleted><Key>{escape(key)}</Key></Deleted>" for key in keys)
        self._answer(200, f"<DeleteResult>{rows}</DeleteResult>".encode())


@contextlib.contextmanager
def fake_s3() -> Iterator[tuple[type[FakeS3], dict[str, str]]]:
    """The server's handler, and the environment by which the server is found."""
    handler = type("Handler", (FakeS3,), {"objects": {}})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        try:
            yield handler, {"AWS_ENDPOINT": address, "AWS_ALLOW_HTTP": "true", "AWS_ACCESS_KEY_ID": "key",
                            "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1"}  # fmt: skip
        finally:
            server.shutdown()
            thread.join()
