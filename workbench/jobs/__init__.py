"""Where work runs: this process, worker processes, a cluster; limits, confinement, what is stored on disk.

An analysis describes its work as a generator function of a model and a job (`Task`) and hands a queue of jobs to a
`Runner`; which runner that is, `runner_choice.choose` decides. `at_work` lets the job note how they ran.
"""
