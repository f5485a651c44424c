"""Who may see a vehicle's topics, and who may say where it is: Zenoh's access control, where what is not allowed is denied."""

from __future__ import annotations

from collections.abc import Sequence

# Of a viewer's messages to us, and of ours to it. Nothing that could change what other viewers see is among the first.
ASKED = ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query")
ANYTHING = ("**", "**/@adv/**", "@ros2_lv/**")  # `**` passes over chunks that begin with @; those of Zenoh's own space are not asked for
GIVEN = ("put", "delete", "reply", "declare_queryable", "liveliness_token")


def access_control(
    given: Sequence[str],
    viewers: Sequence[str] | None,
    poses: str | None = None,
    senders: Sequence[str] | None = None,
    runs: str | None = None,
) -> dict[str, object]:
    """Zenoh's access_control: the key expressions `given` may be read, and nothing written, by whoever shows a certificate with one of the
    common names `viewers`; where that is None, by everyone who can connect. The key expression `poses` may be written by `senders`;
    of `runs` the liveliness tokens of others are heard.

    Zenoh drops a declaration that is not within what is allowed without a word, instead of cutting it down. So anything may be asked for,
    `**` as well, and what goes out is what is `given`.
    """
    who = {"viewers": viewers}
    rules = [("viewers", "ingress", ASKED, ANYTHING), ("viewers", "egress", GIVEN, given)]
    if poses is not None:
        who["senders"] = senders
        rules += [("senders", "ingress", ("put",), (poses,)), ("senders", "egress", ("declare_subscriber",), (poses,))]
    if runs is not None:
        rules += [
            ("viewers", "ingress", ("liveliness_token",), (runs,)),
            ("viewers", "egress", ("declare_liveliness_subscriber",), (runs,)),
        ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {"id": f"{n}", "permission": "allow", "flows": [flow], "messages": said, "key_exprs": list(keys)}
            for n, (_, flow, said, keys) in enumerate(rules)
        ],
        "subjects": [{"id": name} | ({} if names is None else {"cert_common_names": list(names)}) for name, names in who.items()],
        "policies": [{"rules": [f"{n}"], "subjects": [name]} for n, (name, _, _, _) in enumerate(rules)],
    }
