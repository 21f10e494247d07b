"""Runtime: services that every room uses and that know nothing of light.

errors
    `InputError`, the one line that a user's mistake is answered with; `BackendError`.
backend
    The compiler backend: LLVM on the processor, CUDA on a GPU.
progress
    Progress of long work.
storage
    Files of results, written whole or not at all; reading as untrusted input.
process
    A job in a process of its own.
ray_counter
    Number of rays traced, by kind.
random_streams
    Seeds of random numbers, one for each purpose and replicate; evenly spread sequences.
"""
