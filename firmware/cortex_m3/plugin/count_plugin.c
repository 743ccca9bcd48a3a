/* A TCG plugin of qemu 7.2: executions of every address between two marks of count_image.cpp.
 *
 *   -plugin libcount_plugin.so,begin=ADDRESS,end=ADDRESS,out=FILE
 *
 * A line of FILE for each address of each step:   STEP ADDRESS EXECUTIONS TAKEN
 *
 * STEP is the first address after the mark that lies outside the measuring function, TAKEN how often
 * the next instruction was not the following one. Debian has no qemu-plugin.h: the functions used are
 * declared here (interface version 1).
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef struct qemu_info_t qemu_info_t;
typedef void (*tb_callback)(qemu_plugin_id_t, struct qemu_plugin_tb*);
typedef void (*insn_callback)(unsigned, void*);
typedef void (*exit_callback)(qemu_plugin_id_t, void*);
extern void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t, tb_callback);
extern void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn*, insn_callback, int flags,
                                                   void*);
extern void qemu_plugin_register_atexit_cb(qemu_plugin_id_t, exit_callback, void*);
extern size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb*);
extern struct qemu_plugin_insn* qemu_plugin_tb_get_insn(const struct qemu_plugin_tb*, size_t);
extern uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn*);
extern size_t qemu_plugin_insn_size(const struct qemu_plugin_insn*);

__attribute__((visibility("default"))) int qemu_plugin_version = 1;

enum { kAddresses = 1 << 18, kSteps = 64, kNoRegisters = 0 };

struct place {
  uint32_t at, after; /* half-words */
};
struct step {
  uint32_t at;
  uint32_t executed[kAddresses], taken[kAddresses];
};

static struct place* places[kAddresses];
static struct step* steps[kSteps];
static struct step* current;
static uint32_t begin_at, end_at;
static const struct place* last;
static int active;
static char out_path[4096];

static struct step* step_at(uint32_t at) {
  int i;
  for (i = 0; i < kSteps; ++i) {
    if (!steps[i]) {
      steps[i] = calloc(1, sizeof *steps[i]);
      if (!steps[i]) abort();
      steps[i]->at = at;
    }
    if (steps[i]->at == at) return steps[i];
  }
  abort();
}

static void executed(unsigned cpu, void* data) {
  const struct place* p = data;
  (void)cpu;
  if (p->at == begin_at) {
    active = 1;
    current = NULL;
    last = NULL;
    return;
  }
  if (!active) return;
  if (current && last && last->after != p->at) ++current->taken[last->at];
  last = NULL;
  if (p->at == end_at) {
    active = 0;
    return;
  }
  if (p->at > begin_at && p->at < end_at) return;
  if (!current) current = step_at(p->at);
  ++current->executed[p->at];
  last = p;
}

static void translated(qemu_plugin_id_t id, struct qemu_plugin_tb* tb) {
  const size_t n = qemu_plugin_tb_n_insns(tb);
  size_t i;
  (void)id;
  for (i = 0; i < n; ++i) {
    struct qemu_plugin_insn* insn = qemu_plugin_tb_get_insn(tb, i);
    const uint32_t at = (uint32_t)(qemu_plugin_insn_vaddr(insn) / 2);
    if (at >= kAddresses) continue;
    if (!places[at]) {
      places[at] = malloc(sizeof *places[at]);
      if (!places[at]) abort();
      places[at]->at = at;
      places[at]->after = at + (uint32_t)qemu_plugin_insn_size(insn) / 2;
    }
    qemu_plugin_register_vcpu_insn_exec_cb(insn, executed, kNoRegisters, places[at]);
  }
}

static void write_counts(qemu_plugin_id_t id, void* data) {
  FILE* out = fopen(out_path, "w");
  int i;
  (void)id;
  (void)data;
  if (!out) return;
  for (i = 0; i < kSteps && steps[i]; ++i) {
    uint32_t at;
    for (at = 0; at < kAddresses; ++at)
      if (steps[i]->executed[at])
        fprintf(out, "%" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 "\n", 2 * steps[i]->at, 2 * at,
                steps[i]->executed[at], steps[i]->taken[at]);
  }
  fclose(out);
}

__attribute__((visibility("default"))) int qemu_plugin_install(qemu_plugin_id_t id,
                                                               const qemu_info_t* info, int argc,
                                                               char** argv) {
  int i;
  (void)info;
  for (i = 0; i < argc; ++i) {
    if (strncmp(argv[i], "begin=", 6) == 0) begin_at = (uint32_t)strtoul(argv[i] + 6, NULL, 0) / 2;
    if (strncmp(argv[i], "end=", 4) == 0) end_at = (uint32_t)strtoul(argv[i] + 4, NULL, 0) / 2;
    if (strncmp(argv[i], "out=", 4) == 0) snprintf(out_path, sizeof out_path, "%s", argv[i] + 4);
  }
  if (!begin_at || !end_at || !out_path[0]) return -1;
  qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
  qemu_plugin_register_atexit_cb(id, write_counts, NULL);
  return 0;
}
