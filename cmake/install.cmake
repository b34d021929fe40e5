# The framework as a CMake package: find_package(twoport), then link twoport::passivity or another layer, and include <twoport/LAYER/...>.
# Warnings and twoport_options stay here; a user's build has its own.
include(CMakePackageConfigHelpers)
set(twoport_package ${CMAKE_INSTALL_LIBDIR}/cmake/twoport)

# An export for what needs nothing, one for what needs Eigen, one for the rest.
set(twoport_of_plugin plugin)
set(twoport_of_passivity quantities ports passivity)
set(twoport_of_everything proto base mesh arm contact safety hardware link coupling method runtime wire mcap recording scene record secure
                          page platform web sim drivers master slave master_program slave_program)
if(TWOPORT_COMPONENTS)
  set(twoport_exports ${TWOPORT_COMPONENTS})
  set(architecture ARCH_INDEPENDENT)
else()
  set(twoport_exports plugin passivity everything)
  set(architecture "")
  install(TARGETS twoport-master twoport-slave twoport-lab twoport-keygen twoport-device RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  # Written when they are installed, not after each change.
  install(CODE "
    include(\"${PROJECT_SOURCE_DIR}/cmake/headers.cmake\")
    file(REMOVE_RECURSE \"${PROJECT_BINARY_DIR}/include\")
    twoport_write_headers(\"${PROJECT_SOURCE_DIR}\" \"${PROJECT_BINARY_DIR}/include\" common/*.h sim/*.h drivers/*.h master/*.h slave/*.h)
    twoport_write_headers(\"${PROJECT_BINARY_DIR}/generated\" \"${PROJECT_BINARY_DIR}/include\" proto/*.h)")
endif()
install(DIRECTORY ${PROJECT_BINARY_DIR}/include/twoport DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
set(version_header ${PROJECT_BINARY_DIR}/version.h)
if(TWOPORT_COMPONENTS)
  set(version_header ${PROJECT_BINARY_DIR}/include/twoport/version.h)
endif()
configure_file(cmake/version.h.in ${version_header} @ONLY)
install(FILES ${version_header} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/twoport)

foreach(export IN LISTS twoport_exports)
  foreach(name IN LISTS twoport_of_${export})
    set_target_properties(twoport_${name} PROPERTIES EXPORT_NAME ${name})
    install(TARGETS twoport_${name} EXPORT twoport-${export} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  endforeach()
  install(EXPORT twoport-${export} FILE twoport-${export}.cmake NAMESPACE twoport:: DESTINATION ${twoport_package})
endforeach()
configure_package_config_file(cmake/twoport-config.cmake.in ${PROJECT_BINARY_DIR}/twoport-config.cmake
                              INSTALL_DESTINATION ${twoport_package} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/twoport-config-version.cmake COMPATIBILITY SameMinorVersion ${architecture})
install(FILES ${PROJECT_BINARY_DIR}/twoport-config.cmake ${PROJECT_BINARY_DIR}/twoport-config-version.cmake
        DESTINATION ${twoport_package})
