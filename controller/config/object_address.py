"""The address of a store of objects, as `s3://plant/cell-3`."""

import re
from urllib.parse import urlsplit


def object_address(url: str) -> str:
    """Return the address of a store of objects, without a slash at its end.

    Raises
    ------
    ValueError : it has no protocol, or holds a user or an option, which journals would keep
    """
    parts = urlsplit(url)
    if "://" not in url or re.search(":{2}", url) or not url.isprintable():
        raise ValueError("must be an address of the form PROTOCOL://PLACE, as s3://plant/cell-3")
    if "@" in parts.netloc or parts.query or parts.fragment:
        raise ValueError(
            f"the address at {parts.scheme}://{parts.hostname} holds a user or an option, and "
            "journals keep it; leave keys to the environment, as AWS_ACCESS_KEY_ID"
        )
    return url.rstrip("/")
