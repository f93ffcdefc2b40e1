"""Start a Dask scheduler and workers on this machine, for trying out what `--scheduler` does.

Example: python scripts/cluster_local.py 4 --port 8786
Then: workbench nfr fmu:Rudder --input delC --output del --band 0.5:20 --amplitude 1,4 --scheduler tcp://127.0.0.1:8786
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from contextlib import suppress

from workbench.errors import WorkbenchError
from workbench.jobs.limits import cores
from workbench.jobs.local_cluster import started


def main() -> int:
    """Start them and wait for Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("workers", nargs="?", type=int, default=cores(), help="how many; by default one per core")
    parser.add_argument(
        "--host", default="127.0.0.1", help="that the scheduler listens on; by default this machine only"
    )
    parser.add_argument("--port", type=int, default=8786, help="likewise; 0: any")
    parser.add_argument("--tls", metavar="CA,CERT,KEY", help="files of certificates and key, for tls://")
    asked = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends as Ctrl-C does, and leaves nothing behind
    try:
        tls = asked.tls.split(",") if asked.tls else None
        with started(asked.workers, host=asked.host, port=asked.port, tls=tls) as cluster, suppress(KeyboardInterrupt):
            print(f"scheduler  {cluster.scheduler_address}")
            print(f"dashboard  {cluster.dashboard_link}")
            print(f"workers    {asked.workers}; Ctrl-C ends them", flush=True)
            threading.Event().wait()
    except (WorkbenchError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
