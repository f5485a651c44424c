"""AUTOSAR end-to-end protection: what a frame's checksum is, over a data id that is not sent and the bytes beside the checksum.

Profiles 1, 2, 5, 6, 11 and 22 of AUTOSAR's "E2E Protocol Specification" (PRS_E2EProtocol). The counter, which the sum covers, is where they
have it: in the lower half of the byte behind the checksum (1, 2, 11, 22), that byte (5), or the one behind the length (6).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fastcrc import crc8, crc16

Sum = Callable[[bytes], int]  # of the bytes of a frame beside its checksum
LISTED = 16  # data ids, one for each value of the counter
MOST_ID = 0xFFFF


def _both(data: bytes, data_id: int, at: int) -> int:
    return int(crc8.gsm_a(bytes((data_id & 0xFF, data_id >> 8)) + data))


def _low(data: bytes, data_id: int, at: int) -> int:
    return int(crc8.gsm_a(bytes((data_id & 0xFF,)) + data))


def _alternating(data: bytes, data_id: int, at: int) -> int:
    return int(crc8.gsm_a(bytes((data_id >> 8 if data[at] & 1 else data_id & 0xFF,)) + data))


def _nibble(data: bytes, data_id: int, at: int) -> int:
    """The third digit of the id is sent, above the counter; -1, which is nobody's checksum, where it is another."""
    return int(crc8.gsm_a(bytes((data_id & 0xFF, 0)) + data)) if data[at] >> 4 == data_id >> 8 else -1


def _p05(data: bytes, data_id: int, at: int) -> int:
    return int(crc16.ibm_3740(data + data_id.to_bytes(2, "little")))


def _p06(data: bytes, data_id: int, at: int) -> int:
    return int(crc16.ibm_3740(data + data_id.to_bytes(2, "big")))


def _listed(data: bytes, ids: bytes, at: int) -> int:
    counter = data[at] & 0x0F
    return int(crc8.autosar(data + ids[counter : counter + 1]))


BY_ID: dict[str, tuple[Callable[[bytes, int, int], int], int, int]] = {  # with the checksum's bits and the greatest id
    "e2e.p01_both": (_both, 8, MOST_ID),
    "e2e.p01_low": (_low, 8, MOST_ID),
    "e2e.p01_alternating": (_alternating, 8, MOST_ID),
    "e2e.p01_nibble": (_nibble, 8, 0xFFF),
    "e2e.p05": (_p05, 16, MOST_ID),
    "e2e.p06": (_p06, 16, MOST_ID),
    "e2e.p11_both": (_both, 8, MOST_ID),
    "e2e.p11_nibble": (_nibble, 8, 0xFFF),
}
BY_LIST = ("e2e.p02", "e2e.p22")
ALGORITHMS = (*BY_ID, *BY_LIST)


def checksum(algorithm: str, data_id: tuple[int, ...], bits: int, at: int) -> Sum:
    """One of ALGORITHMS for a checksum of that many bits; `at`: where the byte behind it is in the bytes beside it.

    Raises ValueError with what is expected where data ids or bits do not fit the algorithm.
    """
    if algorithm in BY_LIST:
        if len(data_id) != LISTED or not all(0 <= one <= 0xFF for one in data_id) or bits != 8:
            raise ValueError(f"{algorithm} expects a data_id of {LISTED} numbers from 0 to 255 and a checksum of 8 bits")
        return partial(_listed, ids=bytes(data_id), at=at)
    compute, expected, most = BY_ID[algorithm]
    if len(data_id) != 1 or not 0 <= data_id[0] <= most or bits != expected:
        raise ValueError(f"{algorithm} expects a data_id of one number from 0 to {most} and a checksum of {expected} bits")
    return lambda data: compute(data, data_id[0], at)
