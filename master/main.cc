#include "drivers/drivers.h"
#include "master/program.h"

int main(int argc, char** argv) {
  return twoport::master_program(argc, argv, twoport::all_drivers());
}
