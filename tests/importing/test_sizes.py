"""Files that claim or unpack to more than memory holds are refused before they are unpacked."""

import gzip
import io
import subprocess
import sys
import zipfile

import h5py
import numpy as np
import pytest
import scipy.io

from faultgen.errors import InputError
from faultgen.importing import map_of
from faultgen.importing.array_file import read_arrays_of
from faultgen.importing.sizes import MOST_BYTES
from faultgen.recordings.import_log import import_log

MAP = map_of(
    {
        "side": "joint",
        "time": {"sample_period": 0.01},
        "position": {"columns": ["q_1", "q_2"], "unit": "rad"},
        "torque": {"columns": ["tau_1", "tau_2"], "unit": "Nm"},
    }
)
MANY = MOST_BYTES // 8 + 1  # values that are one too many


def npz(path):
    np.savez_compressed(path, q=np.zeros((MANY // 2 + 1, 2)), tau=np.zeros((3, 2)))


def npz_header(path):
    """An array whose header claims more than the file holds."""
    header = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    np.lib.format.write_array_header_1_0(header, shape)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("q.npy", header.getvalue() + bytes(80))


def mat(path):
    scipy.io.savemat(path, {"q": np.zeros((MANY, 1))}, do_compression=True)


def mat_in_bytes(path):
    """Doubles that the file stores as single bytes: 15 MB become 120 MB."""
    scipy.io.savemat(path, {"log": {"q": np.zeros((MANY, 1), np.uint8)}}, do_compression=False)
    content = bytearray(path.read_bytes())
    at = content.index((9).to_bytes(4, "little") + b"\0\0\0\0", 128)  # class mxUINT8
    content[at] = 6  # class mxDOUBLE
    path.write_bytes(content)


def hdf5(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("q", (MANY, 1), "f8", chunks=(1000, 1), compression=1)
        file["q"][:10] = 1.0


def gz(path):
    with gzip.open(path, "wb", 1) as file:
        for _ in range(16):
            file.write(b"1.0,2.0,3.0\n" * 1_000_000)


def dense_xml(path):
    path.write_bytes(b"<a/>" * 2_000_001)


def dense_json(path):
    path.write_bytes(b"[" + b"[]," * 4_000_000 + b"1]")


def short_lines(path):
    path.write_bytes(b"1,2\n" * 2_500_001)


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("log.npz", npz, "its arrays take more than 120 MB in memory"),
        ("log.npz", npz_header, "claims shape (1000000000000,), but has"),
        ("log.mat", mat, "its arrays take more than 120 MB in memory"),
        ("log.mat", mat_in_bytes, "its arrays take more than 120 MB in memory"),
        ("log.mat", hdf5, "its arrays take more than 120 MB in memory"),
        ("log.csv.gz", gz, "more than 150 MB of text"),
        ("log.csv", short_lines, "million lines"),
        ("log.xml", dense_xml, "more than 25 MB of XML, or more than 2 million values"),
        ("log.json", dense_json, "more than 50 MB of JSON, or more than 6 million values"),
    ],
)
def test_what_would_not_fit_is_refused_before_it_is_unpacked(tmp_path, name, make, message):
    """The message states the limit and the way past it, and the memory does not grow by 1 GB."""
    path = tmp_path / name
    make(path)
    code = (
        "import re, sys\n"
        "from faultgen.recordings.import_log import import_log\n"
        "from faultgen.errors import InputError\n"
        "from faultgen.importing import map_of\n"
        f"given = map_of({MAP.model_dump(exclude_none=True)!r})\n"
        "try:\n"
        f"    import_log({str(path)!r}, given)\n"
        "except InputError as error:\n"
        "    print(error)\n"
        # not getrusage, whose peak includes that of the process that started this one
        "print(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    told, peak = done.stdout.splitlines()
    assert message in told
    assert ("shorter logs" in told or "shorter ones" in told) == ("claims" not in message)
    assert int(peak) < 600_000  # [kB]


def test_members_that_are_no_arrays_are_left_out(tmp_path):
    """An .npz file may hold texts and objects beside the arrays."""
    time = 0.01 * np.arange(200)
    q, tau = (np.stack([f(time), f(2 * time)], axis=1) for f in (np.sin, np.cos))
    path = tmp_path / "log.npz"
    np.savez(path, q=q, tau=tau, names=np.array(["a", None], object), label=np.array("arm"))
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("notes.txt", "recorded by hand")
        file.writestr("empty.npy", "")
    assert np.array_equal(import_log(path, MAP).recording.torque, tau)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("q.npy", "no array")
    with pytest.raises(InputError, match="has no arrays of numbers"):
        import_log(path, MAP)


def test_a_cell_may_be_as_long_as_its_line(tmp_path):
    """The reader of CSV files has a limit of 131 072 characters."""
    path = tmp_path / "log.csv"
    rows = "".join(f"0.1,{k},{k},2,note\n" for k in range(50))
    path.write_text(f"q_1,q_2,tau_1,tau_2,{'x' * 200_000}\n{rows}")
    assert import_log(path, MAP).recording.n_axes == 2
    path.write_text(f"q_1,q_2,tau_1,tau_2,text\n0.1,0,0,2,{'x' * 200_000}\n{rows}")
    assert len(import_log(path, MAP).recording.torque) == 51


@pytest.mark.parametrize("compressed", [True, False])
def test_damaged_matlab_files_end_in_one_line(tmp_path, compressed):
    """Bits and bytes of a file are changed in many places; SciPy's reader crashed on some."""
    path = tmp_path / "log.mat"
    time = 0.01 * np.arange(50)
    named = {"q": np.stack([time, time], axis=1), "s": {"x": time, "c": "text"}, "n": [1, 2]}
    scipy.io.savemat(path, named, do_compression=compressed)
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(400):
        content = bytearray(good)
        for at in rng.integers(0, len(good), rng.integers(1, 6)).tolist():
            content[at] = int(rng.choice([0, 1, 5, 14, 15, 0x7F, 0xFF, content[at] ^ 4]))
        path.write_bytes(content)
        try:
            import_log(path, MAP)
        except InputError as error:
            assert "\n" not in str(error)


def test_matlab_files_are_read_to_the_last_bit(tmp_path):
    """All types of numbers, in both kinds of files, and fields of structs."""
    rng = np.random.default_rng(0)
    kinds = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
    given = {f"a_{kind}": (50 * rng.random((40, 2))).astype(kind) for kind in kinds}
    given["whole"] = np.arange(80.0).reshape(40, 2)
    for compressed in (True, False):
        path = tmp_path / "log.mat"
        scipy.io.savemat(path, {**given, "log": {"b": given}}, do_compression=compressed)
        table = read_arrays_of(path)
        for name, values in given.items():
            for prefix in ("", "log.b."):
                for k in range(2):
                    found = table.columns[f"{prefix}{name}_{k + 1}"]
                    assert found.dtype == values.dtype
                    np.testing.assert_array_equal(found, values[:, k])
