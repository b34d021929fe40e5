#include "drivers/drivers.h"
#include "slave/program.h"

int main(int argc, char** argv) {
  return twoport::slave_program(argc, argv, twoport::all_drivers());
}
