# The framework as a CMake package: find_package(twoport), then link twoport::passivity or another layer.
# Warnings and twoport_options stay here; a user's build has its own.
include(CMakePackageConfigHelpers)

set(twoport_layers plugin base ports mesh arm contact passivity safety hardware link coupling method runtime wire mcap recording scene record secure page platform)
set(twoport_exported proto ${twoport_layers} web sim drivers master slave master_program slave_program)
foreach(name IN LISTS twoport_exported)
  set_target_properties(twoport_${name} PROPERTIES EXPORT_NAME ${name})
  install(TARGETS twoport_${name} EXPORT twoport-targets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
endforeach()
install(TARGETS twoport-master twoport-slave twoport-lab twoport-keygen twoport-device RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})

install(DIRECTORY common sim drivers master slave DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/twoport
        FILES_MATCHING PATTERN "*.h")
install(DIRECTORY ${PROJECT_BINARY_DIR}/generated/proto DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/twoport
        FILES_MATCHING PATTERN "*.h")

set(twoport_package ${CMAKE_INSTALL_LIBDIR}/cmake/twoport)
install(EXPORT twoport-targets NAMESPACE twoport:: DESTINATION ${twoport_package})
configure_package_config_file(cmake/twoport-config.cmake.in ${PROJECT_BINARY_DIR}/twoport-config.cmake
                              INSTALL_DESTINATION ${twoport_package})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/twoport-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/twoport-config.cmake ${PROJECT_BINARY_DIR}/twoport-config-version.cmake
        DESTINATION ${twoport_package})
