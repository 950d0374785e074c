/* Ask a field everything that a program may, and print it. */
#define PANDIS_IMPLEMENTATION
#include "pandis.h"
#include <stdio.h>
int main(int count, char **words) {
    static double room[1 << 20];
    pandis_field field;
    double low[3], high[3], force[3] = {7, 7, 7}, at[3], forces[3];
    size_t bytes;
    (void)count;
    if (pandis_open_file(&field, words[1])) return 1;
    memcpy((char *)room + 1, field.data, field.size);
    pandis_field other;
    printf("%d\n", pandis_open(&other, (char *)room + 1, field.size));
    pandis_bounds(&other, low, high);
    if (pandis_provenance(&other, &bytes) || bytes || pandis_bytes(&other) ||
        pandis_longest_side(&other) > 0)
        return 2;
    pandis_bounds(&field, low, high);
    printf("%d %d %.17g", pandis_field_kind(&field), (int)pandis_bytes(&field),
        pandis_longest_side(&field));
    for (int k = 0; k < 3; k++)
        printf(" %.17g %.17g", low[k], high[k]), at[k] = (low[k] + high[k]) / 2;
    const char *text = pandis_provenance(&field, &bytes);
    printf("\n%.*s\n", (int)bytes, text ? text : "");
    double stiff[4] = {(double)INFINITY, -1, (double)NAN, 1};
    for (int i = 0; i < 4; i++) {
        int flag = pandis_force(&field, at, stiff[i], force);
        printf("%d %d ", flag, force[0] == 0 && force[1] == 0 && force[2] == 0);
    }
    pandis_answer answer;
    at[0] = low[0] + 0.02 * (high[0] - low[0]);
    pandis_query(&field, at, &answer);
    printf("\n%.17g\n%s\n", answer.slope, PANDIS_VERSION);
    (void)forces;
    return 0;
}
