"""Prints ratio and speed of c-blosc2 on the taps that the example `table` left in `target/codec`, on one thread.

    pip install blosc2==4.14.1
    python3 codec/examples/c_blosc2.py

The C library in the wheel is called directly, with a context that is created once: Python adds about a microsecond per tap.
"""

import ctypes
import time
from ctypes import c_bool, c_int, c_int16, c_int32, c_uint8, c_void_p
from pathlib import Path

import blosc2

ROUNDS = 20
LZ4, ZSTD = 1, 5
SHUFFLE, BIT_SHUFFLE = 1, 2
ALWAYS_SPLIT, NEVER_SPLIT = 1, 2
# Of the chunk's header.
OVERHEAD_BYTES = 64

# name, codec, level, filter, split mode, bytes per block (0: the library's choice)
SETTINGS = [
    ("lz4 level 5, never split", LZ4, 5, BIT_SHUFFLE, NEVER_SPLIT, 0),
    ("lz4 level 9, never split", LZ4, 9, BIT_SHUFFLE, NEVER_SPLIT, 0),
    ("lz4 level 1, never split", LZ4, 1, BIT_SHUFFLE, NEVER_SPLIT, 0),
    ("lz4 level 5, always split", LZ4, 5, BIT_SHUFFLE, ALWAYS_SPLIT, 0),
    ("lz4 level 5, never split, block 8192", LZ4, 5, BIT_SHUFFLE, NEVER_SPLIT, 8192),
    ("lz4 level 5, bytes shuffled", LZ4, 5, SHUFFLE, NEVER_SPLIT, 0),
    ("zstd level 1, never split", ZSTD, 1, BIT_SHUFFLE, NEVER_SPLIT, 0),
    ("zstd level 1, never split, block 8192", ZSTD, 1, BIT_SHUFFLE, NEVER_SPLIT, 8192),
]


class CParams(ctypes.Structure):
    """`blosc2_cparams` of c-blosc2 3.3."""

    _fields_ = [
        ("compcode", c_uint8), ("compcode_meta", c_uint8), ("clevel", c_uint8), ("use_dict", c_int),
        ("typesize", c_int32), ("nthreads", c_int16), ("blocksize", c_int32), ("splitmode", c_int32),
        ("schunk", c_void_p), ("filters", c_uint8 * 6), ("filters_meta", c_uint8 * 6), ("prefilter", c_void_p),
        ("preparams", c_void_p), ("tuner_params", c_void_p), ("tuner_id", c_int), ("instr_codec", c_bool),
        ("codec_params", c_void_p), ("filter_params", c_void_p * 6),
    ]


class DParams(ctypes.Structure):
    """`blosc2_dparams` of c-blosc2 3.3."""

    _fields_ = [
        ("nthreads", c_int16), ("schunk", c_void_p), ("postfilter", c_void_p), ("postparams", c_void_p),
        ("typesize", c_int32),
    ]


def library():
    lib = ctypes.CDLL(str(Path(blosc2.__file__).parent / "lib" / "libblosc2.so"))
    lib.blosc2_create_cctx.restype = lib.blosc2_create_dctx.restype = c_void_p
    lib.blosc2_create_cctx.argtypes, lib.blosc2_create_dctx.argtypes = [CParams], [DParams]
    for name in ["blosc2_compress_ctx", "blosc2_decompress_ctx"]:
        getattr(lib, name).argtypes = [c_void_p, c_void_p, c_int32, c_void_p, c_int32]
    lib.blosc2_get_version_string.restype = ctypes.c_char_p
    lib.blosc2_init()
    return lib


def best_us(act, count):
    """Mean over the taps of the shortest time of `act` on each, in microseconds."""
    shortest = [float("inf")] * count
    for _ in range(ROUNDS):
        for k in range(count):
            since = time.perf_counter()
            act(k)
            shortest[k] = min(shortest[k], time.perf_counter() - since)
    return sum(shortest) * 1e6 / count


def row(lib, setting, taps, sample_bytes):
    name, codec, level, shuffle, split, block_bytes = setting
    cparams = CParams(compcode=codec, clevel=level, typesize=sample_bytes, nthreads=1, blocksize=block_bytes, splitmode=split)
    cparams.filters[5] = shuffle
    cctx, dctx = lib.blosc2_create_cctx(cparams), lib.blosc2_create_dctx(DParams(nthreads=1))
    tap_bytes = len(taps[0])
    sources = [ctypes.create_string_buffer(tap, tap_bytes) for tap in taps]
    packed = [ctypes.create_string_buffer(tap_bytes + OVERHEAD_BYTES) for _ in taps]
    back = ctypes.create_string_buffer(tap_bytes)
    lengths = [0] * len(taps)

    def pack(k):
        lengths[k] = lib.blosc2_compress_ctx(cctx, sources[k], tap_bytes, packed[k], tap_bytes + OVERHEAD_BYTES)

    def unpack(k):
        lib.blosc2_decompress_ctx(dctx, packed[k], lengths[k], back, tap_bytes)

    pack_us = best_us(pack, len(taps))
    unpack_us = best_us(unpack, len(taps))
    assert min(lengths) > 0 and back.raw == taps[-1], name
    print(f"| c-blosc2, {name} | {tap_bytes * len(taps) / sum(lengths):.2f} | {pack_us:.1f} | {unpack_us:.1f} |")


def main():
    lib = library()
    print("c-blosc2", lib.blosc2_get_version_string().decode(), "of blosc2", blosc2.__version__)
    for path in sorted((Path(__file__).parents[2] / "target" / "codec").iterdir()):
        name, sample_bytes, tap_bytes = path.name.rsplit(".", 2)
        samples, tap_bytes = path.read_bytes(), int(tap_bytes)
        taps = [samples[k : k + tap_bytes] for k in range(0, len(samples), tap_bytes)]
        print(f"\n{name}: {len(taps)} taps of {tap_bytes // int(sample_bytes)} samples of {sample_bytes} bytes\n")
        print("| codec | ratio | pack, us per tap | unpack, us per tap |\n|---|---|---|---|")
        for setting in SETTINGS:
            row(lib, setting, taps, int(sample_bytes))


main()
