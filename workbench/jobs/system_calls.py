"""What a confined process may ask of the system: a list of what is allowed, all else is refused.

Each call has its number on x86_64 and on aarch64 (asm/unistd_64.h, asm-generic/unistd.h), `-` where there is none.
Left out, besides what only administrators may: sockets (but pairs), keys, namespaces, rings (`io_uring`), memory and
message queues of System V, handles of files, owners, permissions, times and attributes of files, locks of files, new
groups and sessions (a process that stays in the worker's group ends with it), and what looks into other processes.
"""

from __future__ import annotations

__all__ = ["AFTER", "CONDITIONS", "INSTEAD", "Condition", "numbers"]

# Argument, bits of it that count, and the values that these may have.
Condition = tuple[int, int, tuple[int, ...]]

_ALL = 0xFFFFFFFF
_ITSELF: Condition = (0, _ALL, (0,))  # the first argument names the process: 0 is the one that calls
_READ_FLAGS_AND_COPIES = (0, 1, 2, 3, 4, 1030)  # F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_SETFL, F_DUPFD_CLOEXEC
_PIPES_AND_SEALS = (1031, 1032, 1033, 1034)  # F_SETPIPE_SZ, F_GETPIPE_SZ, F_ADD_SEALS, F_GET_SEALS
# TCGETS, TIOCGPGRP, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX, FIOCLEX, TCGETS2: none gives a terminal input
_HARMLESS_COMMANDS = (0x5401, 0x540F, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451, 0x802C542A)
# Of the process itself: signal at its parent's end, dumps, name, filter (get), rights (read), slack of timers, no new
# privileges, large pages, vectors (aarch64), speculation; not PR_SCHED_CORE, which names others
_OPTIONS = (1, 2, 3, 4, 15, 16, 21, 23, 29, 30, 38, 39, 41, 42, 50, 51, 52, 53, 0x53564D41)
_NEW_NAMESPACES, _OF_PARENT, _TRACED = 0x7E020000, 0x8000, 0x2000  # CLONE_NEW…, CLONE_PARENT, CLONE_PTRACE
_UNIX, _STREAM, _TYPE = 1, 1, 0xF

# What the arguments must be, where the call alone says too little.
CONDITIONS: dict[str, tuple[Condition, ...]] = {
    "clone": ((0, _NEW_NAMESPACES | _OF_PARENT | _TRACED, (0,)),),
    "fcntl": ((1, _ALL, _READ_FLAGS_AND_COPIES + _PIPES_AND_SEALS),),  # no locks, leases, signals
    "ioctl": ((1, _ALL, _HARMLESS_COMMANDS),),
    "personality": ((0, _ALL, (_ALL,)),),  # a question
    "prctl": ((0, _ALL, _OPTIONS),),
    "prlimit64": (_ITSELF,),
    "sched_setaffinity": (_ITSELF,),
    "sched_setattr": (_ITSELF,),
    "sched_setparam": (_ITSELF,),
    "sched_setscheduler": (_ITSELF,),
    "setpriority": (_ITSELF, (1, _ALL, (0,))),  # PRIO_PROCESS
    "socketpair": ((0, _ALL, (_UNIX,)), (1, _TYPE, (_STREAM,))),  # cannot be connected to another
}

# Calls from this number on are younger than the list. They, and one whose flags lie in memory (no filter sees them),
# are answered as by a kernel that does not have them: the C library takes the older way then.
AFTER = 451
INSTEAD = {"clone3": 435}

_ALLOWED = """
    # files, by name and open: Landlock says which may be changed
    open:2/- openat:257/56 openat2:437/437 creat:85/- close:3/57 close_range:436/436 read:0/63 write:1/64
    pread64:17/67 pwrite64:18/68 readv:19/65 writev:20/66 preadv:295/69 pwritev:296/70 preadv2:327/286
    pwritev2:328/287 lseek:8/62 stat:4/- fstat:5/80 lstat:6/- newfstatat:262/79 statx:332/291 statfs:137/43
    fstatfs:138/44 access:21/- faccessat:269/48 faccessat2:439/439 readlink:89/- readlinkat:267/78 getdents:78/-
    getdents64:217/61 getxattr:191/8 lgetxattr:192/9 fgetxattr:193/10 listxattr:194/11 llistxattr:195/12
    flistxattr:196/13 getcwd:79/17 chdir:80/49 fchdir:81/50 umask:95/166 rename:82/- renameat:264/38 renameat2:316/276
    mkdir:83/- mkdirat:258/34 rmdir:84/- link:86/- linkat:265/37 unlink:87/- unlinkat:263/35 symlink:88/-
    symlinkat:266/36 mknod:133/- mknodat:259/33 truncate:76/45 ftruncate:77/46 fallocate:285/47 fsync:74/82
    fdatasync:75/83 sync_file_range:277/84 readahead:187/213 fadvise64:221/223 copy_file_range:326/285 sendfile:40/71
    dup:32/23 dup2:33/- dup3:292/24 pipe:22/- pipe2:293/59 fcntl:72/25 ioctl:16/29 memfd_create:319/279
    inotify_init:253/- inotify_init1:294/26 inotify_add_watch:254/27 inotify_rm_watch:255/28
    # waiting for them, and what was handed over open
    poll:7/- ppoll:271/73 select:23/- pselect6:270/72 epoll_create:213/- epoll_create1:291/20 epoll_ctl:233/21
    epoll_wait:232/- epoll_pwait:281/22 epoll_pwait2:441/441 eventfd:284/- eventfd2:290/19 signalfd:282/-
    signalfd4:289/74 timerfd_create:283/85 timerfd_settime:286/86 timerfd_gettime:287/87 socketpair:53/199
    sendto:44/206 recvfrom:45/207 sendmsg:46/211 recvmsg:47/212 sendmmsg:307/269 recvmmsg:299/243 shutdown:48/210
    getsockname:51/204 getpeername:52/205 getsockopt:55/209 setsockopt:54/208
    # memory of its own
    brk:12/214 mmap:9/222 munmap:11/215 mremap:25/216 mprotect:10/226 madvise:28/233 msync:26/227 mincore:27/232
    mlock:149/228 mlock2:325/284 mlockall:151/230 munlock:150/229 munlockall:152/231 pkey_mprotect:329/288
    pkey_alloc:330/289 pkey_free:331/290 mbind:237/235 set_mempolicy:238/237 get_mempolicy:239/236 membarrier:324/283
    # processes and threads that it begins, and their signals: Landlock keeps these inside
    clone:56/220 fork:57/- vfork:58/- execve:59/221 execveat:322/281 exit:60/93 exit_group:231/94 wait4:61/260
    waitid:247/95 set_tid_address:218/96 set_robust_list:273/99 get_robust_list:274/100 rseq:334/293 futex:202/98
    futex_waitv:449/449 sched_yield:24/124 prctl:157/167 arch_prctl:158/- restart_syscall:219/128 kill:62/129
    tkill:200/130 tgkill:234/131 rt_sigaction:13/134 rt_sigprocmask:14/135 rt_sigreturn:15/139 rt_sigpending:127/136
    rt_sigtimedwait:128/137 rt_sigsuspend:130/133 sigaltstack:131/132 pause:34/- rt_sigqueueinfo:129/138
    rt_tgsigqueueinfo:297/240
    # limits, priority and place: each of the process itself only, see `CONDITIONS`
    prlimit64:302/261 setrlimit:160/164 getrlimit:97/163 setpriority:141/140 getpriority:140/141
    sched_setaffinity:203/122 sched_getaffinity:204/123 sched_setscheduler:144/119 sched_getscheduler:145/120
    sched_setparam:142/118 sched_getparam:143/121 sched_setattr:314/274 sched_getattr:315/275
    sched_get_priority_max:146/125 sched_get_priority_min:147/126 sched_rr_get_interval:148/127 personality:135/92
    ioprio_get:252/31 getcpu:309/168
    # who and when
    getpid:39/172 getppid:110/173 gettid:186/178 getpgid:121/155 getpgrp:111/- getsid:124/156 getuid:102/174
    geteuid:107/175 getgid:104/176 getegid:108/177 getresuid:118/148 getresgid:120/150 getgroups:115/158 capget:125/90
    uname:63/160 sysinfo:99/179 times:100/153 getrusage:98/165 time:201/- gettimeofday:96/169 clock_gettime:228/113
    clock_getres:229/114 clock_nanosleep:230/115 nanosleep:35/101 alarm:37/- getitimer:36/102 setitimer:38/103
    timer_create:222/107 timer_settime:223/110 timer_gettime:224/108 timer_getoverrun:225/109 timer_delete:226/111
    getrandom:318/278
"""


def numbers(machine: str) -> dict[str, int]:
    """Return the calls that are allowed: name → number.

    Args:
        machine: processor, "x86_64" or "aarch64".
    """
    column = ("x86_64", "aarch64").index(machine)
    words = (word.split(":") for line in _ALLOWED.splitlines() if "#" not in line for word in line.split())
    result = {name: both.split("/")[column] for name, both in words}
    return {name: int(number) for name, number in result.items() if number != "-"}
