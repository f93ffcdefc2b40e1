"""Numbers of the system calls that attempts to escape make, on x86_64 and on aarch64."""

from __future__ import annotations

__all__ = ["CALL_NUMBERS"]

_TEXT = """
    openat2:437/437 fchmodat:268/53 fchmodat2:452/452 shmctl:31/195 semctl:66/191 msgctl:71/187 mq_unlink:241/181
    utimes:235/- setxattrat:463/463 file_setattr:469/469 renameat2:316/276 name_to_handle_at:303/264
    open_by_handle_at:304/265 io_uring_setup:425/425 shmget:29/194 semget:64/190 msgget:68/186 mq_open:240/180
    tkill:200/130 tgkill:234/131 rt_sigqueueinfo:129/138 rt_tgsigqueueinfo:297/240 pidfd_open:434/434
    pidfd_send_signal:424/424 pidfd_getfd:438/438 sched_setattr:314/274 ioprio_set:251/30 ptrace:101/117
    process_vm_readv:310/270 process_vm_writev:311/271 kcmp:312/272 process_madvise:440/440 migrate_pages:256/238
    move_pages:279/239 get_robust_list:274/100 setns:308/268 perf_event_open:298/241 prctl:157/167 clone:56/220
    clone3:435/435 capset:126/91 unshare:272/97 mount:165/40 umount2:166/39 pivot_root:155/41 open_tree:428/428
    fsopen:430/430 move_mount:429/429 mount_setattr:442/442 add_key:248/217 request_key:249/218 keyctl:250/219
    bpf:321/280 userfaultfd:323/282 kexec_load:246/104 init_module:175/105 finit_module:313/273 swapon:167/224
    swapoff:168/225 reboot:169/142 sethostname:170/161 setdomainname:171/162 settimeofday:164/170 clock_settime:227/112
    acct:163/89 syslog:103/116 quotactl:179/60 fanotify_init:300/262 personality:135/92 io_setup:206/0 syncfs:306/267
    clock_adjtime:305/266 memfd_secret:447/447
"""

CALL_NUMBERS: dict[str, tuple[int | None, int | None]] = {
    name: tuple(None if number == "-" else int(number) for number in both.split("/"))  # type: ignore[misc]
    for name, both in (word.split(":") for word in _TEXT.split())
}
