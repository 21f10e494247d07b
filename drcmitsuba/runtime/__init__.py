"""Runtime: services that every room uses and that know nothing of light.

errors
    `InputError`, which describes a user's mistake in one line; `BackendError`.
toml
    Reading and checking of the tables of a file.
registration
    Plugins and LLVM, as soon as any module imports Dr.Jit or Mitsuba.
lazy
    Modules, and names of a package, that are imported at their first use.
backend, llvm_library
    The compiler backend: LLVM on the processor, CUDA on a GPU; the library of LLVM.
compilation, kernel_folder
    What a run compiled, how long that took, and where kernels are kept.
machine_speed
    Speed of this machine relative to the one on which costs were measured.
machine_memory
    Memory of the machine that arrays may take, and what the process has taken.
progress
    Progress of long work.
interruption, time_limit
    Ctrl-C and SIGTERM of the command line; the time for further rounds of samples.
launch_size
    Numbers of sensors, paths, photons and shadow rays in one launch.
flat_arrays, aligned_arrays
    NumPy arrays on the device; those that it takes without a copy.
labelled
    Arrays of users, read by their labels.
storage, zarr_folder
    Files of results, written whole or not at all; arrays in chunks.
folder_lock
    A folder that one process at a time writes to.
byte_size
    Sizes of memory and files as users write them.
threads, pieces
    Work of NumPy in several threads; pieces of arrays that stay in a core's cache.
background
    Jobs in a thread beside the main one.
process
    A job in a process of its own.
ray_counter
    Number of rays by kind and purpose.
release
    The version of the program.
content_key, provenance
    Digest of content; what made a number: its inputs and the program.
random_streams
    Seeds of random numbers, one for each purpose and replicate; evenly spread sequences.
"""
