# The Debian package: `scripts/package` writes out/package/twoport_VERSION_ARCH.deb with programs,
# library, headers, the Python module, the page (in the program), man pages, completion, scenes, examples and documents. Its files outside /usr are in
# cmake/packaging/root: limits and udev rule of the group realtime, which its installation makes.

set(pages "")
foreach(program twoport-master twoport-slave twoport-lab twoport-device twoport-keygen)
  set(page ${PROJECT_BINARY_DIR}/man/${program}.1.gz)
  add_custom_command(OUTPUT ${page}
                     COMMAND ${CMAKE_COMMAND} -E make_directory ${PROJECT_BINARY_DIR}/man
                     COMMAND sh -c "${PROJECT_SOURCE_DIR}/cmake/packaging/man_page $<TARGET_FILE:${program}> ${PROJECT_VERSION} | gzip -9n >${page}"
                     DEPENDS ${program} ${PROJECT_SOURCE_DIR}/cmake/packaging/man_page VERBATIM)
  list(APPEND pages ${page})
endforeach()
add_custom_target(twoport-man ALL DEPENDS ${pages})
install(FILES ${pages} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
foreach(program twoport-master twoport-slave twoport-lab twoport-device twoport-keygen)
  install(FILES cmake/packaging/twoport.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME ${program})
endforeach()
install(DIRECTORY scenes arms DESTINATION ${CMAKE_INSTALL_DATADIR}/twoport COMPONENT scenes
        FILES_MATCHING PATTERN "*.textproto" PATTERN "*.csv" PATTERN "*.urdf" PATTERN "*.stl")
install(DIRECTORY docs/examples/play DESTINATION ${CMAKE_INSTALL_DATADIR}/twoport COMPONENT scenes)
install(PROGRAMS scripts/play DESTINATION ${CMAKE_INSTALL_BINDIR} RENAME twoport-play)
install(DIRECTORY docs/examples DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY docs/ DESTINATION ${CMAKE_INSTALL_DOCDIR} FILES_MATCHING PATTERN "*.md" PATTERN "*.png")
install(FILES README.md CHANGELOG.md SECURITY.md DESTINATION ${CMAKE_INSTALL_DOCDIR})

# Debian wants the licence in a format of its own.
file(STRINGS LICENSE licence)
list(TRANSFORM licence PREPEND " ")
list(TRANSFORM licence REPLACE "^ $" " .")
list(JOIN licence "\n" licence)
file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/packaging/copyright @ONLY CONTENT
"Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: twoport

Files: *
Copyright: 2026 The twoport authors
License: BSD-3-Clause
@licence@
")
install(FILES ${PROJECT_BINARY_DIR}/packaging/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR})

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME twoport)
set(CPACK_PACKAGE_VENDOR "twoport developers")
set(CPACK_PACKAGE_CONTACT "twoport developers <twoport@example.org>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "passive bilateral teleoperation over delayed, lossy links")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
    "Programs for a haptic device and a robot that feel each other over UDP,\nwith passivity control at both ends; a laboratory that runs the same\ncontrollers in virtual time; library and headers for own programs and\nfor drivers as plug-ins.")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_INSTALLED_DIRECTORIES ${PROJECT_SOURCE_DIR}/cmake/packaging/root /)
set(CPACK_STRIP_FILES ON)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SUGGESTS
    "g++, cmake, libeigen3-dev, libboost-dev, libprotobuf-dev, libfmt-dev, libspdlog-dev, libcli11-dev, libssl-dev, libevdev-dev, libspnav-dev, liburdfdom-dev, spacenavd")
if(twoport_python)
  math(EXPR next "${Python3_VERSION_MINOR} + 1")
  set(CPACK_DEBIAN_PACKAGE_DEPENDS
      "python3 (>= ${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR}~), python3 (<< ${Python3_VERSION_MAJOR}.${next}~)")
  set(CPACK_DEBIAN_PACKAGE_RECOMMENDS python3-numpy)
endif()
list(APPEND CPACK_DEBIAN_PACKAGE_RECOMMENDS qrencode)
list(JOIN CPACK_DEBIAN_PACKAGE_RECOMMENDS ", " CPACK_DEBIAN_PACKAGE_RECOMMENDS)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${PROJECT_SOURCE_DIR}/cmake/packaging/debian/postinst
                                       ${PROJECT_SOURCE_DIR}/cmake/packaging/debian/conffiles)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
include(CPack)
