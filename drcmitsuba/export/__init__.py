"""Cases and results as files of other programs, for a second opinion.

radiance
    A case as a scene of Radiance, with the script that simulates it.
scene_files, primitives, sources, script
    Parts of that folder: surfaces, materials, sky and suns, commands.
programs
    The programs of Radiance on this machine.
matrices, mtx
    C and L of a result as matrices whose product is E.
tables
    E of a result as DAYSIM's .ill and as CSV.
"""
