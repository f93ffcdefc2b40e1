"""Numbers of the system calls that attempts to escape make, on x86_64 and on aarch64."""

from __future__ import annotations

__all__ = ["CALL_NUMBERS"]

_TEXT = """
    open:2/- openat:257/56 openat2:437/437 truncate:76/45 creat:85/- fchmodat:268/53 fchmodat2:452/452 chown:92/-
    shmctl:31/195 semctl:66/191 msgctl:71/187 mq_unlink:241/181 lchown:94/- fchownat:260/54 utimensat:280/88
    utimes:235/- setxattr:188/5 fsetxattr:190/7 lsetxattr:189/6 removexattr:197/14 setxattrat:463/463
    removexattrat:466/466 file_setattr:469/469 renameat2:316/276 mknodat:259/33 name_to_handle_at:303/264
    open_by_handle_at:304/265 splice:275/76 flock:73/32 socket:41/198 socketpair:53/199 sendto:44/206
    io_uring_setup:425/425 accept:43/202 listen:50/201 bind:49/200 connect:42/203 shmget:29/194 semget:64/190
    msgget:68/186 mq_open:240/180 kill:62/129 tkill:200/130 tgkill:234/131 rt_sigqueueinfo:129/138
    rt_tgsigqueueinfo:297/240 pidfd_open:434/434 pidfd_send_signal:424/424 pidfd_getfd:438/438 prlimit64:302/261
    sched_setaffinity:203/122 sched_setscheduler:144/119 sched_setparam:142/118 sched_setattr:314/274
    setpriority:141/140 ioprio_set:251/30 ptrace:101/117 process_vm_readv:310/270 process_vm_writev:311/271
    kcmp:312/272 process_madvise:440/440 process_mrelease:448/448 migrate_pages:256/238 move_pages:279/239
    get_robust_list:274/100 setns:308/268 perf_event_open:298/241 prctl:157/167 setsid:112/157 setpgid:109/154
    clone:56/220 clone3:435/435 capset:126/91 unshare:272/97 mount:165/40 umount2:166/39 pivot_root:155/41
    chroot:161/51 open_tree:428/428 fsopen:430/430 move_mount:429/429 mount_setattr:442/442 add_key:248/217
    request_key:249/218 keyctl:250/219 bpf:321/280 userfaultfd:323/282 kexec_load:246/104 init_module:175/105
    finit_module:313/273 swapon:167/224 swapoff:168/225 reboot:169/142 sethostname:170/161 setdomainname:171/162
    settimeofday:164/170 clock_settime:227/112 acct:163/89 syslog:103/116 quotactl:179/60 fanotify_init:300/262
    personality:135/92 io_setup:206/0 sync:162/81 syncfs:306/267 lookup_dcookie:212/18 ioperm:173/- iopl:172/-
    modify_ldt:154/- adjtimex:159/171 clock_adjtime:305/266 memfd_secret:447/447 setgroups:116/159
"""

CALL_NUMBERS: dict[str, tuple[int | None, int | None]] = {
    name: tuple(None if number == "-" else int(number) for number in both.split("/"))  # type: ignore[misc]
    for name, both in (word.split(":") for word in _TEXT.split())
}
