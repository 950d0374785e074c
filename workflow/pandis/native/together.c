/* Fields, contacts and scenes in one library, as a package brings it along. */
#define _POSIX_C_SOURCE 199309L
#define PANDIS_IMPLEMENTATION
#include "runtime/runtime.c"
#include "contact/contact.c"
#include "scene/scene.c"
