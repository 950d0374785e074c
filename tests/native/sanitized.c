/* The programs that run under sanitizers, in one: compiling the header takes half a minute. The
 * first argument names the program. */
#define main api
#include "api.c"
#undef main
#define main refusals
#include "refusals.c"
#undef main
#define main fuzz
#include "fuzz.c"
#undef main

int main(int count, char **words) {
    if (count > 1 && !strcmp(words[1], "api")) return api();
    if (count > 1 && !strcmp(words[1], "refusals")) return refusals(count - 1, words + 1);
    if (count > 1 && !strcmp(words[1], "fuzz")) return fuzz(count - 1, words + 1);
    return 2;
}
