# Read by ctest, once the tests of the programs are known: gtest_discover_tests takes no list for a property.
set_tests_properties(${timing_tests} ${doctor_live_tests} PROPERTIES LABELS "loopback;long")
