/* The mode table the image is built with, in the sector where a later one will replace it. */
#define ANTINODE_TABLE_PLACE __attribute__((section(".table"), used))
#include "mode_table.h"
