// bullet_drape.cc - the sphere drape of bench_drape.c in Bullet (zlib licence, distribution package
// libbullet-dev), compiled and run by bench_drape.c.
//   c++ -O3 bench/bullet_drape.cc $(pkg-config --cflags --libs bullet)
//   a.out MESH OUT FRAMES [key=value ...]
// MESH: binary: int nv, int nf, double x [nv x 3], int faces [nf x 3]. OUT: binary: double x [nv x 3]
// after each frame of 1/60 s. Prints one line: median and mean ms of CPU a frame, contacts of cloth
// with itself in all steps, links.
//
//   world=soft        the older world: lengths of links, by position; implicit, explicit: the newer
//                     one, springs in N/m
//   iterations=10     soft: passes over contacts and links a step
//   substeps=1        steps a frame
//   stiffness=1       soft: linear stiffness of a link, (0, 1]; else N/m
//   bend=0            the same for links over two edges; 0: none
//   self=none         soft: 'flag' sets the package's flags for clusters against clusters of one body
//                     with one cluster a face; 'call' calls the collider that the flags stand for after
//                     each step; else: 'flag' turns self-collision on
//   clusters=0        0: one a face
//   voxel=0.02        m, cells of the sampled distance of the sphere (package's default: 0.25)
//   damping=0         not soft: of a spring, N s/m
//   shuffle=1         soft: links in random order, as the package's own meshes have
//
// The newer world's tolerances are absolute numbers made for masses of kilograms: with 5e-5 kg a vertex
// it takes no step at all. So masses and springs are given to it in units of 0.1 g (SCALE).
//
// It is ended after 100 s of CPU: some settings never end a step.
//
// What is matched: mesh, masses (a third of each face), sphere, friction 0.3, contact at 2 mm, no
// damping. What has no counterpart is said in bench_drape.c.
#include <BulletSoftBody/btDeformableBodySolver.h>
#include <BulletSoftBody/btDeformableMultiBodyDynamicsWorld.h>
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <BulletSoftBody/btSoftBodyInternals.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <BulletSoftBody/btSoftRigidDynamicsWorld.h>
#include <btBulletDynamicsCommon.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <string>
#include <vector>

namespace {

const double SCALE = 1e4;                   // of masses and forces in the newer world

struct Mesh {
    int nv = 0, nf = 0;
    std::vector<double> x;
    std::vector<int>    faces;
};

struct Setting {
    bool        deform = false, implicit = true, shuffle = true;
    int         iterations = 10, substeps = 1, clusters = 0;
    double      stiffness = 1, bend = 0, voxel = 0.02, damping = 0;
    std::string self = "none";
};

double cpu() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

bool load(const char *path, Mesh &m) {
    FILE *f = std::fopen(path, "rb");
    bool  good = f && std::fread(&m.nv, sizeof(int), 1, f) == 1 &&
                std::fread(&m.nf, sizeof(int), 1, f) == 1;
    if (good) {
        m.x.resize(3 * (size_t)m.nv);
        m.faces.resize(3 * (size_t)m.nf);
        good = std::fread(m.x.data(), sizeof(double), m.x.size(), f) == m.x.size() &&
               std::fread(m.faces.data(), sizeof(int), m.faces.size(), f) == m.faces.size();
    }
    if (f) std::fclose(f);
    return good;
}

bool parse(const std::string &word, Setting &s) {
    const size_t cut = word.find('=');
    if (cut == std::string::npos) return false;
    const std::string key = word.substr(0, cut), text = word.substr(cut + 1);
    const double      value = std::atof(text.c_str());
    if (key == "world") s.deform = text != "soft", s.implicit = text == "implicit";
    else if (key == "iterations") s.iterations = (int)value;
    else if (key == "substeps") s.substeps = (int)value;
    else if (key == "clusters") s.clusters = (int)value;
    else if (key == "stiffness") s.stiffness = value;
    else if (key == "bend") s.bend = value;
    else if (key == "voxel") s.voxel = value;
    else if (key == "damping") s.damping = value;
    else if (key == "shuffle") s.shuffle = value != 0;
    else if (key == "self") s.self = text;
    else return false;
    return true;
}

btSoftBody *make_cloth(btSoftBodyWorldInfo &info, const Mesh &m, const Setting &s) {
    std::vector<btVector3> at;
    for (int i = 0; i < m.nv; i++)
        at.push_back(btVector3(btScalar(m.x[3 * i]), btScalar(m.x[3 * i + 1]),
                               btScalar(m.x[3 * i + 2])));
    btSoftBody *cloth = new btSoftBody(&info, m.nv, at.data(), nullptr);
    cloth->m_materials[0]->m_kLST = s.deform ? btScalar(1) : btScalar(s.stiffness);
    for (int i = 0; i < m.nf; i++) {
        const int *f = &m.faces[3 * i];
        for (int k = 0; k < 3; k++) cloth->appendLink(f[k], f[(k + 1) % 3], 0, true);
        cloth->appendFace(f[0], f[1], f[2]);
    }
    if (s.bend > 0) {
        btSoftBody::Material *soft = cloth->appendMaterial();
        soft->m_kLST = s.deform ? btScalar(1) : btScalar(s.bend);
        cloth->generateBendingConstraints(2, soft);
    }
    cloth->getCollisionShape()->setMargin(btScalar(0.002));
    cloth->setTotalMass(btScalar(0.2 * (s.deform ? SCALE : 1)), true);
    cloth->m_cfg.piterations = s.iterations;
    cloth->m_cfg.kDF = btScalar(0.3);       // times the sphere's friction, which is 1
    cloth->m_cfg.kKHR = 1;                  // hardness against what does not move
    return cloth;
}

struct World {
    btSoftBodyRigidBodyCollisionConfiguration config;
    btCollisionDispatcher                     dispatcher{&config};
    btDbvtBroadphase                          broad;
    btSphereShape                             ball{btScalar(0.3)};
    btDefaultMotionState                      where{btTransform(
        btQuaternion::getIdentity(), btVector3(btScalar(0.5), btScalar(-0.4), btScalar(0.5)))};
    btRigidBody sphere{btRigidBody::btRigidBodyConstructionInfo(0, &where, &ball)};
    std::vector<std::vector<double>> frames;
    std::vector<double>              ms;

    World() { sphere.setFriction(1); }

    void keep(const btSoftBody *cloth, double start) {
        std::vector<double> x;
        ms.push_back(1e3 * (cpu() - start));
        for (int i = 0; i < cloth->m_nodes.size(); i++)
            for (int k = 0; k < 3; k++) x.push_back(double(cloth->m_nodes[i].m_x[k]));
        frames.push_back(x);
    }
};

void prepare(btSoftBodyWorldInfo &info, const btVector3 &gravity, const Setting &s) {
    info.m_gravity = gravity;
    info.air_density = 0;
    info.m_sparsesdf.setDefaultVoxelsz(btScalar(s.voxel));
    info.m_sparsesdf.Reset();
}

long run_soft(World &w, const Mesh &m, const Setting &s, int frames, int *links) {
    btSequentialImpulseConstraintSolver solver;
    btSoftRigidDynamicsWorld            world(&w.dispatcher, &w.broad, &solver, &w.config);
    const btVector3                     gravity(0, btScalar(-9.81), 0);
    btSoftBodyWorldInfo                &info = world.getWorldInfo();
    long                                touches = 0;
    world.setGravity(gravity);
    info.m_sparsesdf.Initialize();
    prepare(info, gravity, s);
    world.addRigidBody(&w.sphere);
    btSoftBody *cloth = make_cloth(info, m, s);
    cloth->m_cfg.collisions = btSoftBody::fCollision::SDF_RS;
    if (s.shuffle) cloth->randomizeConstraints();
    if (s.self != "none") {
        cloth->generateClusters(s.clusters);
        cloth->m_cfg.kSSHR_CL = 1;          // hardness of that; its default is 0.5
    }
    if (s.self == "flag")
        cloth->m_cfg.collisions |= btSoftBody::fCollision::CL_SS | btSoftBody::fCollision::CL_SELF;
    world.addSoftBody(cloth);
    *links = cloth->m_links.size();
    for (int i = 0; i < frames; i++) {
        const double start = cpu();
        for (int k = 0; k < s.substeps; k++) {
            world.stepSimulation(btScalar(1.0 / 60 / s.substeps), 0);
            if (s.self == "call") {
                btSoftColliders::CollideCL_SS collider;
                collider.ProcessSoftSoft(cloth, cloth);
            }
            touches += cloth->m_joints.size();
        }
        info.m_sparsesdf.GarbageCollect();
        w.keep(cloth, start);
    }
    world.removeSoftBody(cloth);
    delete cloth;
    world.removeRigidBody(&w.sphere);
    return touches;
}

long run_deform(World &w, const Mesh &m, const Setting &s, int frames, int *links) {
    btDeformableBodySolver                solver;
    btDeformableMultiBodyConstraintSolver contact;
    contact.setDeformableSolver(&solver);
    btDeformableMultiBodyDynamicsWorld world(&w.dispatcher, &w.broad, &contact, &w.config, &solver);
    const btVector3                    gravity(0, btScalar(-9.81), 0);
    btDeformableMassSpringForce        springs(btScalar(SCALE * s.stiffness),
                                               btScalar(SCALE * s.damping), true, SCALE * s.bend);
    btDeformableGravityForce           weight(gravity);
    long                               touches = 0;
    world.setGravity(gravity);
    prepare(world.getWorldInfo(), gravity, s);
    world.addRigidBody(&w.sphere);
    btSoftBody *cloth = make_cloth(world.getWorldInfo(), m, s);
    cloth->m_cfg.collisions = btSoftBody::fCollision::SDF_RD | btSoftBody::fCollision::SDF_RDN;
    if (s.self != "none") cloth->m_cfg.collisions |= btSoftBody::fCollision::VF_DD;
    cloth->m_sleepingThreshold = 0;
    world.addSoftBody(cloth);
    cloth->setSelfCollision(s.self != "none");
    world.addForce(cloth, &springs);
    world.addForce(cloth, &weight);
    world.setImplicit(s.implicit);
    world.setLineSearch(s.implicit);
    world.setUseProjection(true);           // its other solver does not move the cloth
    *links = cloth->m_links.size();
    for (int i = 0; i < frames; i++) {
        const double start = cpu();
        for (int k = 0; k < s.substeps; k++) {
            const btScalar h = btScalar(1.0 / 60 / s.substeps);
            world.stepSimulation(h, 1, h);
            touches += cloth->m_faceNodeContacts.size();
        }
        w.keep(cloth, start);
    }
    world.removeForce(cloth, &springs);
    world.removeForce(cloth, &weight);
    world.removeSoftBody(cloth);
    delete cloth;
    world.removeRigidBody(&w.sphere);
    return touches;
}

}  // namespace

int main(int argc, char **argv) {
    Mesh    m;
    Setting s;
    World   w;
    int     links = 0;
    if (argc < 4 || !load(argv[1], m)) return 2;
    for (int i = 4; i < argc; i++)
        if (!parse(argv[i], s)) return 2;
    const rlimit most = {100, 100};         // s of CPU: some settings never end a step
    setrlimit(RLIMIT_CPU, &most);
    const int  frames = std::atoi(argv[3]);
    const long touches = s.deform ? run_deform(w, m, s, frames, &links)
                                  : run_soft(w, m, s, frames, &links);
    FILE *out = std::fopen(argv[2], "wb");
    if (!out) return 1;
    for (const std::vector<double> &x : w.frames)
        if (std::fwrite(x.data(), sizeof(double), x.size(), out) != x.size()) return 1;
    std::fclose(out);
    double sum = 0;
    for (double t : w.ms) sum += t;
    std::sort(w.ms.begin(), w.ms.end());
    std::printf("%.3f %.3f %ld %d\n", w.ms[w.ms.size() / 2], sum / frames, touches, links);
    return 0;
}
