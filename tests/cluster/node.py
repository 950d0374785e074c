"""A Slurm cluster of one node, this machine, of Debian's packages: real daemons, no system files.

Usage: .venv/bin/python tests/cluster/node.py [--no-database] COMMAND...

starts `munged`, MariaDB, `slurmdbd`, `slurmctld` and `slurmd` in a folder of their own, runs the
command with the cluster in its environment (SLURM_CONF), and stops them. It needs root and
`apt-get install slurm-wlm slurmdbd mariadb-server munge`. With ``--no-database`` the cluster keeps
no accounts, as small ones often do.
"""

import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

NEEDED = ("munged", "slurmctld", "slurmd", "slurmdbd", "mariadbd", "mariadb-install-db")
DAEMONS = "/usr/sbin:/usr/bin:/sbin:/bin"
PATIENCE = 60  # seconds


def missing():
    """Return what keeps this machine from being a node, or nothing."""
    if os.getuid() != 0:
        return "a cluster's daemons need root"
    lacking = [name for name in NEEDED if not shutil.which(name, path=DAEMONS)]
    return f"Debian's slurm-wlm, slurmdbd, mariadb-server: no {', '.join(lacking)}" * bool(lacking)


def free_ports(count):
    """Return ports that nothing listens on."""
    taken = [socket.socket() for _ in range(count)]
    for one in taken:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in taken]
    for one in taken:
        one.close()
    return ports


class Cluster:
    """The daemons, by name; a context that starts and stops them.

    Parameters
    ----------
    folder : path-like
        For their files; short, for sockets' paths may not be long.
    database : bool
        Whether there is a `slurmdbd`, without which `sacct` knows nothing.
    min_job_age : int
        Seconds for which `squeue` still knows a job that has ended.
    """

    def __init__(self, folder, database=True, min_job_age=300):
        self.folder, self.database = Path(folder).resolve(), database
        self.min_job_age = min_job_age
        self.running = {}
        self.ports = dict(zip(("ctld", "d", "dbd", "sql"), free_ports(4), strict=True))
        self.environment = os.environ | {"SLURM_CONF": str(self.folder / "slurm.conf")}
        self.environment["PATH"] += f":{DAEMONS}"

    def __enter__(self):
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            self._start_all()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for name in [*self.running][::-1]:
            self.stop(name)

    def _start_all(self):
        key = self.folder / "munge.key"
        key.write_bytes(secrets.token_bytes(128))
        key.chmod(0o400)
        own = {"key-file": key, "socket": self.folder / "munge.sock", "num-threads": 2}
        own |= {f"{what}-file": self.folder / f"munged.{what}" for what in ("pid", "seed", "log")}
        flags = [f"--{name}={value}" for name, value in own.items()]
        self._run("munged", "--foreground", "--force", *flags)
        self._until(own["socket"].exists, "munged")
        (self.folder / "slurm.conf").write_text(self._configuration())
        if self.database:
            self._start_database()
        self.start("slurmctld")
        self.start("slurmd")
        self._until(lambda: "idle" in self.ask("sinfo", "--noheader", "--format=%T"), "slurmd")

    def _configuration(self):
        cores = os.cpu_count()
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
        host, at = socket.gethostname().split(".")[0], self.folder
        lines = {
            "ClusterName": "one", "SlurmctldHost": f"{host}(127.0.0.1)",
            "SlurmUser": "root", "SlurmdUser": "root",
            "SlurmctldPort": self.ports["ctld"], "SlurmdPort": self.ports["d"],
            "AuthType": "auth/munge", "AuthInfo": f"socket={at}/munge.sock",
            "CredType": "cred/munge",
            "StateSaveLocation": f"{at}/state", "SlurmdSpoolDir": f"{at}/spool",
            "SlurmctldPidFile": f"{at}/slurmctld.pid", "SlurmdPidFile": f"{at}/slurmd.pid",
            "SlurmctldLogFile": f"{at}/slurmctld.log", "SlurmdLogFile": f"{at}/slurmd.log",
            "ProctrackType": "proctrack/linuxproc", "TaskPlugin": "task/none",
            "SelectType": "select/cons_tres", "SelectTypeParameters": "CR_Core_Memory",
            "SchedulerType": "sched/backfill", "SchedulerParameters": "batch_sched_delay=1",
            "MinJobAge": self.min_job_age, "ReturnToService": 2, "KillWait": 5,
            "SlurmdTimeout": 60, "MpiDefault": "none", "JobAcctGatherType": "jobacct_gather/linux",
            "JobAcctGatherFrequency": 5,
        }  # fmt: skip
        if self.database:
            lines |= {"AccountingStorageType": "accounting_storage/slurmdbd",
                      "AccountingStorageHost": "127.0.0.1",
                      "AccountingStoragePort": self.ports["dbd"],
                      "AccountingStoragePass": f"{at}/munge.sock"}  # fmt: skip
        else:
            lines["AccountingStorageType"] = "accounting_storage/none"
        text = "".join(f"{name}={value}\n" for name, value in lines.items())
        node = f"NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory={memory - 256}"
        part = f"PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP"
        return f"{text}{node} State=UNKNOWN\n{part}\n"

    def _start_database(self):
        at, data = self.folder, self.folder / "sql"
        self._call("mariadb-install-db", "--no-defaults", f"--datadir={data}", "--user=root",
                   "--auth-root-authentication-method=normal", "--skip-test-db")  # fmt: skip
        self._run("mariadbd", "--no-defaults", f"--datadir={data}", "--user=root",
                  "--bind-address=127.0.0.1", f"--port={self.ports['sql']}",
                  f"--socket={at}/sql.sock", f"--pid-file={at}/mariadbd.pid",
                  "--innodb-log-file-size=16M", "--innodb-buffer-pool-size=64M")  # fmt: skip
        sql = ("create user slurm@'127.0.0.1' identified by 'slurm'; "
               "grant all on slurm_acct_db.* to slurm@'127.0.0.1'")  # fmt: skip
        ask = "mariadb", "--no-defaults", f"--socket={at}/sql.sock", "-u", "root", "-e"
        self._until(lambda: self._succeeds(*ask, "select 1"), "mariadbd")
        self._call(*ask, sql)
        lines = {
            "AuthType": "auth/munge", "AuthInfo": f"socket={at}/munge.sock",
            "DbdHost": "localhost", "DbdPort": self.ports["dbd"], "SlurmUser": "root",
            "LogFile": f"{at}/slurmdbd.log", "PidFile": f"{at}/slurmdbd.pid",
            "StorageType": "accounting_storage/mysql", "StorageHost": "127.0.0.1",
            "StoragePort": self.ports["sql"], "StorageUser": "slurm", "StoragePass": "slurm",
        }  # fmt: skip
        path = at / "slurmdbd.conf"
        path.write_text("".join(f"{name}={value}\n" for name, value in lines.items()))
        path.chmod(0o600)
        self.start("slurmdbd")
        self._until(lambda: self._succeeds("sacctmgr", "-n", "list", "cluster"), "slurmdbd")
        self._call("sacctmgr", "-i", "add", "cluster", "one")

    # --- daemons ---------------------------------------------------------------

    def start(self, name):
        """Start one of Slurm's daemons."""
        (self.folder / "state").mkdir(exist_ok=True)
        self._run(name, "-D")

    def stop(self, name, how=signal.SIGTERM):
        """End a daemon; with SIGKILL, as a machine that fails does."""
        process = self.running.pop(name)
        process.send_signal(how)
        with suppress(subprocess.TimeoutExpired):
            process.wait(20)
        if process.poll() is None:
            process.kill()
            process.wait()

    def restart(self, name, how=signal.SIGKILL):
        """End a daemon and start it again."""
        self.stop(name, how)
        self.start(name)

    def ask(self, *command):
        """Return what one of Slurm's commands prints; nothing if it fails."""
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True,
                              check=False)  # fmt: skip
        return done.stdout if done.returncode == 0 else ""

    def _run(self, name, *words):
        with (self.folder / f"{name}.out").open("ab") as log:
            self.running[name] = subprocess.Popen(
                [name, *words], env=self.environment, stdin=subprocess.DEVNULL, stdout=log,
                stderr=log, start_new_session=True,
            )  # fmt: skip

    def _call(self, *command):
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True,
                              check=False)  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)}: {done.stdout}{done.stderr}")

    def _succeeds(self, *command):
        return subprocess.run(command, env=self.environment, capture_output=True,
                              check=False).returncode == 0  # fmt: skip

    def _until(self, holds, name):
        end = time.monotonic() + PATIENCE
        while not holds():
            if name in self.running and self.running[name].poll() is not None:
                said = (self.folder / f"{name}.out").read_text(errors="replace")
                raise RuntimeError(f"{name} ended: {said[-2000:]}")
            if time.monotonic() > end:
                raise RuntimeError(f"{name} did not start within {PATIENCE} s")
            time.sleep(0.1)


def main(words):
    """Run a command with a cluster."""
    database = words[:1] != ["--no-database"]
    command = words if database else words[1:]
    if not command:
        print(__doc__, file=sys.stderr)
        return 2
    fault = missing()
    if fault:
        print(f"error: {fault}", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as folder, Cluster(folder, database) as cluster:
        return subprocess.run(command, env=cluster.environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
