"""Ends with 0 if the review answers at its port, even if only to say that it does not know who is asking."""

import http.client
import os
import sys

connection = http.client.HTTPConnection("127.0.0.1", int(os.environ.get("TCFIT_PORT", "8080")), timeout=5)
try:
    connection.request("GET", "/")
    status = connection.getresponse().status
except OSError as error:
    sys.exit(f"no answer: {error}")
sys.exit(0 if status in (200, 401, 403, 429) else f"answered with {status}")
