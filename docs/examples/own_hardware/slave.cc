#include "twoport/drivers/drivers.h"
#include "twoport/slave/program.h"

namespace twoport {
void add_own_robot(Registry& all);
}

int main(int argc, char** argv) {
  twoport::Registry drivers = twoport::all_drivers();
  twoport::add_own_robot(drivers);
  return twoport::slave_program(argc, argv, drivers);
}
