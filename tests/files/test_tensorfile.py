"""The container: what `safetensors` reads, we write; what is not sound is refused before memory is
taken.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from dronecombat_jax.errors import EXIT_DATA
from dronecombat_jax.files import tensorfile
from dronecombat_jax.files.tensorfile import PolicyError

ARRAYS = {
    "b": np.arange(6, dtype=np.float32).reshape(2, 3),
    "a.0": np.array([0.1, -0.0, 3e38], np.float32),
    "count": np.array(7, np.float32),
    "empty": np.zeros((0, 4), np.float32),
}
METADATA = {"format": "x", "näme": 'quotes " and \n lines'}


def raw(header: dict | bytes | str, data: bytes = b"", length: int | None = None) -> bytes:
    """A file with this header, whatever it says."""
    text = (
        header
        if isinstance(header, bytes)
        else (header if isinstance(header, str) else json.dumps(header)).encode()
    )
    return (len(text) if length is None else length).to_bytes(8, "little") + text + data


def entry(shape=(2,), offsets=(0, 8), dtype="F32") -> dict:
    return {"dtype": dtype, "shape": list(shape), "data_offsets": list(offsets)}


def nested(depth: int) -> str:
    return '{"a":' + "[" * depth + "]" * depth + "}"


EIGHT = bytes(8)
HOSTILE = {
    "empty file": (b"", "0 bytes"),
    "seven bytes": (bytes(7), "7 bytes"),
    "header longer than the file": (
        raw({}, length=500),
        "invalid header length",
    ),
    "header bomb": (raw({}, bytes(1_100_000), length=2**60), "longer than 1,000,000 bytes"),
    "header over the cap": (raw(" " * 1_000_001), "longer than 1,000,000 bytes"),
    "no JSON": (raw("{"), "damaged or no safetensors file"),
    "no UTF-8": (raw(b'{"\xff": 1}'), "damaged or no safetensors file"),
    "a list": (raw("[]"), "invalid type: sequence"),
    "nested deeply": (raw(nested(200_000)), "recursion limit"),
    "shape of 1e12": (
        raw({"a": entry((10**6, 10**6), (0, 4 * 10**12))}, EIGHT),
        "not fully covered",
    ),
    "shape of 2**64": (raw({"a": entry((2**32, 2**32), (0, 0))}), "overflow"),
    "negative shape": (raw({"a": entry((-1, -2))}, EIGHT), "invalid JSON"),
    "true as a shape": (raw({"a": entry((True, 2))}, EIGHT), "invalid JSON"),
    "float as a shape": (raw({"a": entry((2.0,))}, EIGHT), "invalid JSON"),
    "9 dimensions": (raw({"a": entry((1,) * 9, (0, 4))}, bytes(4)), "at most 8 dimensions"),
    "10000 digits": (
        raw('{"a":{"dtype":"F32","shape":[' + "9" * 10_000 + '],"data_offsets":[0,8]}}', EIGHT),
        "damaged",
    ),
    "NaN as a shape": (
        raw('{"a":{"dtype":"F32","shape":[NaN],"data_offsets":[0,8]}}', EIGHT),
        "no",
    ),
    "offsets do not fit the shape": (
        raw({"a": entry(offsets=(0, 4))}, EIGHT),
        "invalid shape",
    ),
    "offsets backwards": (raw({"a": entry(offsets=(8, 0))}, EIGHT), "invalid offset"),
    "offsets past the end": (raw({"a": entry(offsets=(4, 12))}, EIGHT), "invalid offset"),
    "overlap": (
        raw({"a": entry(), "b": entry(offsets=(4, 12))}, bytes(12)),
        "invalid offset",
    ),
    "the same bytes twice": (raw({"a": entry(), "b": entry()}, EIGHT), "invalid offset"),
    "gap": (raw({"a": entry(offsets=(4, 12))}, bytes(12)), "invalid offset"),
    "bytes left over": (raw({"a": entry()}, bytes(9)), "not fully covered"),
    "metadata that is no text": (raw({"__metadata__": {"x": 1}}), "invalid type"),
    "metadata that is a list": (raw({"__metadata__": ["x"]}), "invalid type"),
    "float64": (
        raw({"a": entry((1,), dtype="F64")}, EIGHT),
        "array a: expected dtype F32, got F64",
    ),
    "dtype on two lines": (raw({"a": entry(dtype="F\n32")}, EIGHT), "unknown variant"),
    "no offsets": (
        raw({"a": {"dtype": "F32", "shape": [2]}}, EIGHT),
        "invalid JSON",
    ),
    "a number for an array": (raw({"a": 1}), "invalid JSON"),
    "name that is a path": (raw({"../../x": entry()}, EIGHT), "is not allowed"),
    "hidden name": (raw({".x": entry()}, EIGHT), "is not allowed"),
    "name with a line break": (raw({"a\nerror: b": entry()}, EIGHT), "is not allowed"),
    "name of 101 characters": (raw({"a" * 101: entry()}, EIGHT), "is not allowed"),
    "pickle that runs a command": (
        b"cposix\nsystem\n(S'touch MARKER'\ntR.",
        "damaged or no safetensors file",
    ),
    "zip, as torch.save writes": (b"PK\x03\x04" + bytes(100), "damaged or no safetensors file"),
    "npy": (
        b"\x93NUMPY\x01\x00v\x00{'descr': '|O', 'fortran_order': False}" + bytes(60),
        "damaged or no safetensors",
    ),
}


def test_the_library_reads_what_we_write(tmp_path):
    (tmp_path / "x").write_bytes(tensorfile.encode(ARRAYS, METADATA))
    with safe_open(tmp_path / "x", framework="numpy") as file:
        assert file.metadata() == METADATA
        assert set(file.keys()) == set(ARRAYS)
        for name, array in ARRAYS.items():
            assert file.get_tensor(name).dtype == np.float32
            assert (
                file.get_tensor(name).tobytes() == array.tobytes()
                and file.get_tensor(name).shape == array.shape
            )


def test_we_read_what_the_library_writes(tmp_path):
    save_file(ARRAYS, tmp_path / "x", METADATA)
    arrays, metadata = tensorfile.read(tmp_path / "x")
    assert metadata == METADATA and set(arrays) == set(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].tobytes() == array.tobytes() and arrays[name].shape == array.shape
        assert arrays[name].dtype == np.float32 and arrays[name].flags.writeable


def test_the_same_content_gives_the_same_bytes_in_any_order():
    backwards = dict(reversed(ARRAYS.items()))
    assert tensorfile.encode(ARRAYS, METADATA) == tensorfile.encode(backwards, METADATA)


@pytest.mark.parametrize(("name", "array"), [("a", np.zeros(2)), ("../a", np.zeros(2, np.float32))])
def test_other_arrays_are_not_written(name, array):
    with pytest.raises(ValueError, match="only float32 arrays with plain names"):
        tensorfile.encode({name: array}, {})


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_files_are_refused_in_one_line(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    content, words = HOSTILE[case]
    Path("x.safetensors").write_bytes(content)
    with pytest.raises(PolicyError) as error:
        tensorfile.read(Path("x.safetensors"))
    message = error.value.message
    assert (
        error.value.exit_code == EXIT_DATA
        and message.startswith("x.safetensors: ")
        and words in message
    )
    assert message.isprintable() and len(message) < 400
    assert os.listdir() == ["x.safetensors"]


def test_they_take_no_memory(tmp_path):
    """All of them, in a process that may grow by 64 MiB only."""
    for number, (content, _) in enumerate(HOSTILE.values()):
        (tmp_path / str(number)).write_bytes(content)
    sparse = tmp_path / "sparse"  # 2 GiB that take no disk
    with sparse.open("wb") as file:
        file.truncate(2 << 30)
    code = f"""
import resource
from pathlib import Path
from dronecombat_jax.files import tensorfile
pages = int(Path("/proc/self/statm").read_text().split()[0])
limit = pages * resource.getpagesize() + (64 << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
refused = 0
for path in Path({str(tmp_path)!r}).iterdir():
    try:
        tensorfile.read(path)
    except tensorfile.PolicyError:
        refused += 1
print(refused)
"""
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60
    )
    assert result.stdout.strip() == str(len(HOSTILE) + 1), result.stderr


def test_only_a_plain_file_is_opened(tmp_path):
    (tmp_path / "there").write_bytes(tensorfile.encode(ARRAYS, {}))
    (tmp_path / "link").symlink_to(tmp_path / "there")
    (tmp_path / "nowhere").symlink_to(tmp_path / "missing")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    refusals = {
        "link": "it is a link; give the file itself",
        "nowhere": "it is a link; give the file itself",
        "missing": "No such file or directory",
        "folder": "not a plain file",
        "pipe": "not a plain file",
        "there/below": "Not a directory",
        "n" * 300: "File name too long",
        "nul\0": "null byte",
    }
    for name, words in refusals.items():
        with pytest.raises(PolicyError, match=words):
            tensorfile.read(tmp_path / name)


def test_a_name_on_two_lines_gives_a_message_on_one(tmp_path):
    with pytest.raises(PolicyError) as error:
        tensorfile.read(tmp_path / "a\nerror: b")
    assert error.value.message.isprintable()
