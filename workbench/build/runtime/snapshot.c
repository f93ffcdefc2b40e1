/* snapshot.c: saved FMU states (see instance.h).
 *
 * A saved state is one block: header, record, input polynomials, domains of the event indicators, what the core saves,
 * which grows with the past of delays. It holds no pointer, so that its bytes are also its serialisation; the header
 * says for which build they are, and how many.
 */
#include "instance.h"

typedef struct {
    char magic[8];
    uint64_t fingerprint;
    uint64_t size; /* of the whole block, in bytes */
} Header;

static const char magic[8] = {'W', 'B', 'F', 'M', 'U', 'S', 'T', '1'};

static uint64_t hash_bytes(uint64_t hash, const void *bytes, size_t n)
{
    const unsigned char *next = bytes;
    for (size_t i = 0; i < n; i++) { /* FNV-1a */
        hash = (hash ^ next[i]) * UINT64_C(1099511628211);
    }
    return hash;
}

static size_t inputs_size(const Instance *instance)
{
    return instance->inputs.n * sizeof(InputPolynomial);
}

static size_t sides_size(void)
{
    return model_info.n_indicators * sizeof(double);
}

static size_t turned_size(void)
{
    return turned_doubles() * sizeof(double);
}

static size_t size_before_core(const Instance *instance)
{
    return sizeof(Header) + sizeof(Record) + inputs_size(instance) + sides_size() + turned_size();
}

static size_t block_size(const Instance *instance)
{
    return size_before_core(instance) + core_saved_size(instance->core);
}

static size_t size_of(const void *block)
{
    Header header;
    memcpy(&header, block, sizeof header);
    return (size_t)header.size;
}

/* Model, version, kind and the representation of numbers on this machine. */
static uint64_t fingerprint(const Instance *instance)
{
    const double number = -1.5;
    const size_t sizes[] = {size_before_core(instance), sizeof(size_t), (size_t)instance->fmi, (size_t)instance->kind,
                            instance->event_mode_used ? 1U : 0U};
    uint64_t hash = UINT64_C(14695981039346656037);
    hash = hash_bytes(hash, model_info.token, strlen(model_info.token));
    hash = hash_bytes(hash, sizes, sizeof sizes);
    return hash_bytes(hash, &number, sizeof number);
}

static bool is_ours(const Instance *instance, const void *bytes)
{
    Header header;
    memcpy(&header, bytes, sizeof header);
    return memcmp(header.magic, magic, sizeof magic) == 0 && header.size > size_before_core(instance)
        && header.fingerprint == fingerprint(instance);
}

/* Whether bytes of the right size, which may come from anywhere, can be a state: what is used as a number of things, as
 * a state or as a flag is one. Other values are as good as those that an environment may set. */
static bool holds(const Instance *instance, const void *bytes)
{
    Record record;
    const size_t before = size_before_core(instance);
    const unsigned char *block = bytes;
    memcpy(&record, block + sizeof(Header), sizeof record);
    return instance_can_be(instance, record.state) && core_holds(block + before, size_of(bytes) - before);
}

static Status check(Instance *instance, const void *saved)
{
    if (instance_missing(instance, saved, "FMUstate")) {
        return STATUS_ERROR;
    }
    if (!is_ours(instance, saved)) {
        return instance_fail(instance, "the saved state belongs to another model, build or interface");
    }
    return STATUS_OK;
}

static void fill(Instance *instance, unsigned char *block)
{
    Header header;
    memcpy(header.magic, magic, sizeof magic);
    header.fingerprint = fingerprint(instance);
    header.size = block_size(instance);
    memcpy(block, &header, sizeof header);
    block += sizeof header;
    memcpy(block, &instance->record, sizeof(Record));
    block += sizeof(Record);
    memcpy(block, instance->inputs.polynomials, inputs_size(instance));
    block += inputs_size(instance);
    memcpy(block, instance->sides, sides_size());
    block += sides_size();
    memcpy(block, instance->turned, turned_size());
    core_save(instance->core, block + turned_size());
}

static Status new_block(Instance *instance, void **saved, size_t size)
{
    *saved = memory_new(&instance->memory, size, 1);
    return *saved != NULL ? STATUS_OK : instance_fail(instance, "out of memory");
}

Status snapshot_save(Instance *instance, void **saved)
{
    if (instance_missing(instance, saved, "FMUstate")) {
        return STATUS_ERROR;
    }
    Status status = *saved == NULL ? STATUS_OK : check(instance, *saved);
    if (status == STATUS_OK && *saved != NULL && size_of(*saved) != block_size(instance)) {
        memory_delete(&instance->memory, *saved);
        *saved = NULL;
    }
    if (status == STATUS_OK && *saved == NULL) {
        status = new_block(instance, saved, block_size(instance));
    }
    if (status == STATUS_OK) {
        fill(instance, *saved);
    }
    return status;
}

Status snapshot_restore(Instance *instance, const void *saved)
{
    Status status = check(instance, saved);
    if (status != STATUS_OK) {
        return status;
    }
    const unsigned char *block = saved;
    if (!holds(instance, saved)) {
        return instance_fail(instance, "the saved state is damaged");
    }
    if (!core_load(instance->core, block + size_before_core(instance))) {
        return instance_fail(instance, "out of memory");
    }
    block += sizeof(Header);
    memcpy(&instance->record, block, sizeof(Record));
    block += sizeof(Record);
    memcpy(instance->inputs.polynomials, block, inputs_size(instance));
    inputs_end(&instance->inputs);
    block += inputs_size(instance);
    memcpy(instance->sides, block, sides_size());
    block += sides_size();
    memcpy(instance->turned, block, turned_size());
    return STATUS_OK;
}

Status snapshot_delete(Instance *instance, void **saved)
{
    if (saved == NULL || *saved == NULL) {
        return STATUS_OK;
    }
    memory_delete(&instance->memory, *saved);
    *saved = NULL;
    return STATUS_OK;
}

Status snapshot_size(Instance *instance, const void *saved, size_t *size)
{
    Status status = check(instance, saved);
    if (status != STATUS_OK || instance_missing(instance, size, "size")) {
        return STATUS_ERROR;
    }
    *size = size_of(saved);
    return STATUS_OK;
}

static Status check_size(Instance *instance, const void *bytes, size_t size, size_t expected)
{
    if (instance_missing(instance, bytes, "serializedState")) {
        return STATUS_ERROR;
    }
    if (size != expected) {
        return instance_fail(instance, "a serialised state has %zu bytes, not %zu", expected, size);
    }
    return STATUS_OK;
}

Status snapshot_write(Instance *instance, const void *saved, void *bytes, size_t size)
{
    Status status = check(instance, saved);
    status = status == STATUS_OK ? check_size(instance, bytes, size, size_of(saved)) : status;
    if (status == STATUS_OK) {
        memcpy(bytes, saved, size);
    }
    return status;
}

Status snapshot_read(Instance *instance, const void *bytes, size_t size, void **saved)
{
    if (instance_missing(instance, bytes, "serializedState") || instance_missing(instance, saved, "FMUstate")) {
        return STATUS_ERROR;
    }
    if (size <= size_before_core(instance)) {
        return instance_fail(instance, "a serialised state has more than %zu bytes, not %zu", size_before_core(instance), size);
    }
    Status status = check(instance, bytes);
    status = status == STATUS_OK ? check_size(instance, bytes, size, size_of(bytes)) : status;
    if (status == STATUS_OK && !holds(instance, bytes)) {
        return instance_fail(instance, "the serialised state is damaged");
    }
    status = status == STATUS_OK ? new_block(instance, saved, size) : status;
    if (status == STATUS_OK) {
        memcpy(*saved, bytes, size);
    }
    return status;
}
