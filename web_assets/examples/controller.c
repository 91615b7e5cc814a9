/* A control law in C: PD with weight compensation. cc -O2 -o controller controller.c && ./controller 9000
 * Then, elsewhere: flexlab --law tcp://localhost:9000 */
#include <arpa/inet.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef unsigned char *Bytes;
static uint64_t number(Bytes p, int size) { uint64_t n = 0; while (size--) n = n << 8 | *p++; return n; }

/* Behind the MessagePack value at p, of the kinds that flexlab sends; its numbers go to *out, if there is an out. */
static Bytes value(Bytes p, double **out) {
    int kind = *p++;
    if (kind == 0xcb) { uint64_t bits = number(p, 8); if (out) memcpy((*out)++, &bits, 8); return p + 8; }
    if (kind < 0x80) { if (out) *(*out)++ = kind; return p; }               /* A whole number. */
    if (kind != 0xdc && kind >> 4 != 9) fprintf(stderr, "what is 0x%x?\n", kind), exit(1);
    uint64_t count = kind == 0xdc ? p += 2, number(p - 2, 2) : kind & 15;   /* A list. */
    while (count--) p = value(p, out);
    return p;
}

/* The numbers under a name of a message, which has more than 15, row by row; `found` has room for them. */
static void get(Bytes p, const char *name, double *found) {
    uint64_t pairs = number(p + 1, 2);
    for (p += 3; pairs--; ) {
        size_t size = *p++ & 31, is_it = size == strlen(name) && !memcmp(p, name, size);
        p = value(p + size, is_it ? &found : NULL);
    }
}

static int receive(int from, Bytes body, size_t room) {
    size_t size = recv(from, body, 4, MSG_WAITALL) == 4 ? number(body, 4) : 0;
    return size && size <= room && recv(from, body, size, MSG_WAITALL) == (ssize_t)size;
}

int main(int count, char **words) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons(count > 1 ? atoi(words[1]) : 9000),
                               .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int server = socket(AF_INET, SOCK_STREAM, 0);
    setsockopt(server, SOL_SOCKET, SO_REUSEADDR, &(int){1}, sizeof(int));
    if (bind(server, (struct sockaddr *)&here, sizeof here) || listen(server, 1)) return perror("controller"), 1;
    getsockname(server, (struct sockaddr *)&here, &(socklen_t){sizeof here});
    printf("listening: flexlab --law tcp://localhost:%d\n", ntohs(here.sin_port)), fflush(stdout);
    for (int lab; (lab = accept(server, NULL, NULL)) >= 0; close(lab)) {
        static unsigned char in[65536], out[256];
        if (!receive(lab, in, sizeof in) || send(lab, "\0\0\0\x0a\x81\xa7version\1", 14, 0) != 14) continue;
        while (receive(lab, in, sizeof in)) {
            double arms, x[3], v[3], x_d[3], v_d[3], weights[6], share[2];
            get(in, "arm_count", &arms), get(in, "pose", x), get(in, "pose_rate", v), get(in, "desired_pose", x_d);
            get(in, "desired_rate", v_d), get(in, "weights", weights), get(in, "share", share);
            Bytes end = (Bytes)memcpy(out + 4, "\x81\xa6inputs", 8) + 8;
            *end++ = 0x90 | (int)arms;
            for (int i = 0; i < 3 * arms; i++) {
                int a = i % 3;
                double pd = -2e4 * (x[a] - x_d[a]) - 800 * (v[a] - v_d[a]);
                union { double input; uint64_t bits; } u = {weights[i] + share[i / 3] * pd};
                if (a == 0) *end++ = 0x93;
                *end++ = 0xcb;
                for (int k = 56; k >= 0; k -= 8) *end++ = u.bits >> k;
            }
            out[3] = end - out - 4;
            if (send(lab, out, end - out, 0) != end - out) break;
        }
    }
}
