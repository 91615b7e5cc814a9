/* A control law in C: PD with weight compensation. cc -O2 -o controller controller.c && ./controller 9000
 * Then, elsewhere: flexlab --law tcp://localhost:9000 */
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef const unsigned char *Bytes;
static uint64_t number(Bytes p, int size) { uint64_t n = 0; while (size--) n = n << 8 | *p++; return n; }

/* MessagePack: behind the value at p; its numbers go to *out, one after the other, if there is an out. */
static Bytes value(Bytes p, double **out) {
    int kind = *p++, wide = kind & 1 ? 4 : 2;
    uint64_t count = 0, text = 0;
    double x = 0;
    if (kind < 0x80) x = kind;
    else if (kind < 0x90) count = 2 * (kind & 15);
    else if (kind < 0xa0) count = kind & 15;
    else if (kind < 0xc0) text = kind & 31;
    else if (kind == 0xcb) { uint64_t bits = number(p, 8); memcpy(&x, &bits, 8); p += 8; }
    else if (kind >= 0xcc && kind <= 0xcf) { x = number(p, 1 << (kind - 0xcc)); p += 1 << (kind - 0xcc); }
    else if (kind >= 0xd9 && kind <= 0xdb) { text = number(p, 1 << (kind - 0xd9)); p += 1 << (kind - 0xd9); }
    else if (kind >= 0xdc && kind <= 0xdf) { count = number(p, wide) << (kind >= 0xde); p += wide; }
    else fprintf(stderr, "what is 0x%x?\n", kind), exit(1);
    if (out && !count && !text) *(*out)++ = x;
    while (count--) p = value(p, out);
    return p + text;
}

/* The numbers under a name, row by row; `found` has room for them. */
static void get(Bytes p, const char *name, double *found) {
    uint64_t pairs = *p == 0xde ? number(p + 1, 2) : *p & 15;
    for (p += *p == 0xde ? 3 : 1; pairs--; p = value(p, NULL)) {
        size_t length = *p & 31;                                  /* Names are shorter than 32 bytes. */
        int fits = length == strlen(name) && !memcmp(p + 1, name, length);
        p = value(p, NULL);
        if (fits) value(p, &found);
    }
}

static int receive(int from, unsigned char *body, size_t room) {
    unsigned char head[4];
    if (recv(from, head, 4, MSG_WAITALL) != 4 || number(head, 4) > room) return 0;
    return recv(from, body, number(head, 4), MSG_WAITALL) == (ssize_t)number(head, 4);
}

int main(int count, char **words) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons(count > 1 ? atoi(words[1]) : 9000),
                               .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int server = socket(AF_INET, SOCK_STREAM, 0), yes = 1;
    socklen_t size = sizeof here;
    setsockopt(server, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (bind(server, (struct sockaddr *)&here, size) || listen(server, 1)) return perror("controller"), 1;
    getsockname(server, (struct sockaddr *)&here, &size);
    printf("listening: flexlab --law tcp://localhost:%d\n", ntohs(here.sin_port)), fflush(stdout);
    for (int lab; (lab = accept(server, NULL, NULL)) >= 0; close(lab)) {
        static unsigned char in[65536], out[256];
        setsockopt(lab, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        if (!receive(lab, in, sizeof in) || send(lab, "\0\0\0\x0a\x81\xa7version\1", 14, 0) != 14) continue;
        while (receive(lab, in, sizeof in)) {
            double arms, x[3], v[3], x_d[3], v_d[3], weights[6], share[2];
            get(in, "arm_count", &arms), get(in, "pose", x), get(in, "pose_rate", v), get(in, "desired_pose", x_d);
            get(in, "desired_rate", v_d), get(in, "weights", weights), get(in, "share", share);
            unsigned char *end = out + 4;
            memcpy(end, "\x81\xa6inputs", 8), end += 8, *end++ = 0x90 | (int)arms;
            for (int i = 0; i < arms; i++) {
                *end++ = 0x93;
                for (int a = 0; a < 3; a++) {
                    double u = weights[3 * i + a] + share[i] * (-2e4 * (x[a] - x_d[a]) - 800 * (v[a] - v_d[a]));
                    uint64_t bits;
                    memcpy(&bits, &u, 8), *end++ = 0xcb;
                    for (int k = 56; k >= 0; k -= 8) *end++ = bits >> k;
                }
            }
            uint32_t length = htonl(end - out - 4);
            memcpy(out, &length, 4);
            if (send(lab, out, end - out, 0) != end - out) break;
        }
    }
}
