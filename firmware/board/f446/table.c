/* Mode table built into the image, in the flash sector where an uploaded table replaces it. */
#define ANTINODE_TABLE_PLACE __attribute__((section(".table"), used))
#include "mode_table.h"
