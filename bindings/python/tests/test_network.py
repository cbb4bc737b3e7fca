"""Several hosts: network namespaces with addresses of their own, a bridge between them, and no disk in common.

Where namespaces may not be made (not root, or no iproute2) the tests say that they skipped.
"""

import contextlib
import os
import subprocess
import sys
import time

import pytest
from test_engines import distributed, make_sweep, results, rows_of_journal  # noqa: F401

import caudal

#: Of this test's bridge: nobody else's, as tests may run at the same time.
NET = f"10.{200 + os.getpid() % 50}.{os.getpid() // 50 % 250}"


def ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


@pytest.fixture
def hosts():
    """Two hosts by names of their namespaces; this one is NET.1, on the same bridge."""
    mark = os.getpid()
    bridge, names = f"cau{mark}", [f"caudal{mark}-{k}" for k in (1, 2)]
    try:
        ip("link", "add", bridge, "type", "bridge")
        ip("address", "add", f"{NET}.1/24", "dev", bridge)
        ip("link", "set", bridge, "up")
        for k, name in enumerate(names):
            ip("netns", "add", name)
            ip("link", "add", f"c{k}-{mark}", "type", "veth", "peer", "name", "eth0", "netns", name)
            ip("link", "set", f"c{k}-{mark}", "master", bridge, "up")
            ip("-n", name, "address", "add", f"{NET}.{11 + k}/24", "dev", "eth0")
            ip("-n", name, "link", "set", "eth0", "up")
            ip("-n", name, "link", "set", "lo", "up")
        subprocess.run(["ip", "netns", "exec", names[0], "unshare", "--mount", "true"], check=True, capture_output=True)
        yield names
    except (OSError, subprocess.CalledProcessError) as error:
        why = getattr(error, "stderr", None) or str(error)
        why = why.decode() if isinstance(why, bytes) else why
        pytest.skip(f"workers in network namespaces: as root, apt-get install iproute2 ({why.strip()})")
    finally:
        with contextlib.suppress(OSError):
            for name in names:
                subprocess.run(["ip", "netns", "delete", name], capture_output=True)
            subprocess.run(["ip", "link", "delete", bridge], capture_output=True)


def test_workers_on_other_hosts_without_our_disk_give_our_results_to_the_bit_and_one_may_die(distributed, hosts, tmp_path):  # noqa: F811
    sweep = make_sweep(tmp_path, count=40, duration=4.0)
    caudal.sweep(sweep, out=tmp_path / "ours")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask, file = [sys.executable, "-m", "dask"], tmp_path / "scheduler.json"
    scheduler = [*dask, "scheduler", "--host", f"{NET}.1", "--port", "0", "--no-dashboard", "--scheduler-file", file]
    started = [subprocess.Popen(scheduler, **quiet)]
    try:
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        with distributed.Client(scheduler_file=str(file), timeout=60) as client:
            address = client.scheduler.address
            assert NET in address
            # On its host the worker has an empty folder where ours is.
            worker = f'mount -t tmpfs caudal {tmp_path} && cd {tmp_path} && exec "$@"'
            for name in hosts:
                apart = ["ip", "netns", "exec", name, "unshare", "--mount", "sh", "-c", worker, "worker"]
                started.append(subprocess.Popen([*apart, *dask, "worker", address, "--nthreads", "1", "--no-dashboard"], **quiet))
            client.wait_for_workers(2, timeout=60)
            places = {worker["host"] for worker in client.scheduler_info(n_workers=-1)["workers"].values()}
            assert places == {f"{NET}.11", f"{NET}.12"}
            assert client.submit(lambda path: __import__("os").path.exists(path), str(sweep)).result() is False
            told = []

            def kill(done, of):
                told.append(done)
                if done >= 10 and started[1].poll() is None:
                    started[1].kill()

            caudal.sweep(sweep, out=tmp_path / "out", client=client, progress=kill)
    finally:
        for process in started:
            process.kill()
            process.wait()
    assert rows_of_journal(tmp_path / "out") == rows_of_journal(tmp_path / "ours")
    assert results(tmp_path / "out") == results(tmp_path / "ours")
