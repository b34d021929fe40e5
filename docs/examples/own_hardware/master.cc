#include "twoport/drivers/drivers.h"
#include "twoport/master/program.h"

namespace twoport {
void add_own_device(Registry& all);
}

int main(int argc, char** argv) {
  twoport::Registry drivers = twoport::all_drivers();
  twoport::add_own_device(drivers);
  return twoport::master_program(argc, argv, drivers);
}
