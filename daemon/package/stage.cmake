# Runs before Debian packages are made of the staged files: compresses what Debian wants compressed. Packages have the
# same contents and dependencies wherever they are built.
if(NOT CPACK_PM_OPTIONAL)
    message(FATAL_ERROR "packages have the page of `portmetd view`, and METIS: install libwebsockets-dev and libmetis-dev, "
                        "and configure again")
endif()
file(GLOB_RECURSE pages ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/*/usr/share/man/*/*.[15]
     ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/*/usr/share/doc/*/changelog)
foreach(page ${pages})
    execute_process(COMMAND gzip -9nf ${page} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
