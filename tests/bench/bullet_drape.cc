// bullet_drape.cc - the sphere drape of bench_contact.c in Bullet's soft body (zlib licence,
// distribution package libbullet-dev), compiled and run by bench_contact.c.
//   c++ -O2 bench/bullet_drape.cc $(pkg-config --cflags --libs bullet)
//   a.out N STEPS OUT     N x N vertices, 1/60 s a step; OUT: binary, N N 3 doubles at the end
// prints one line: median and mean ms of CPU a step.
//
// The same sheet, mass, sphere and step. Bullet's cloth is a net of springs; its linear stiffness
// is left at the most it takes (1), with 4 iterations of positions and bending springs over two
// edges. Its vertices meet the sphere; cloth with itself is its clusters' affair, which a net of
// springs has none of: not asked for.
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <BulletSoftBody/btSoftRigidDynamicsWorld.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

static double cpu() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int argc, char **argv) {
    if (argc < 4) return 2;
    const int n = std::atoi(argv[1]), steps = std::atoi(argv[2]);
    btSoftBodyRigidBodyCollisionConfiguration config;
    btCollisionDispatcher               dispatcher(&config);
    btDbvtBroadphase                    broad;
    btSequentialImpulseConstraintSolver solver;
    btSoftRigidDynamicsWorld            world(&dispatcher, &broad, &solver, &config);
    const btVector3                     gravity(0, btScalar(-9.81), 0);
    world.setGravity(gravity);
    btSoftBodyWorldInfo &info = world.getWorldInfo();
    info.m_gravity = gravity;
    info.air_density = 0;
    info.m_sparsesdf.Initialize();

    btSphereShape        ball(btScalar(0.3));
    const btVector3      center(btScalar(0.5), btScalar(-0.4), btScalar(0.5));
    btDefaultMotionState where(btTransform(btQuaternion::getIdentity(), center));
    btRigidBody          sphere(btRigidBody::btRigidBodyConstructionInfo(0, &where, &ball));
    sphere.setFriction(1);
    world.addRigidBody(&sphere);

    btSoftBody *cloth = btSoftBodyHelpers::CreatePatch(info, btVector3(0, 0, 0), btVector3(1, 0, 0),
                                                       btVector3(0, 0, 1), btVector3(1, 0, 1), n, n,
                                                       0, true);
    btSoftBody::Material *soft = cloth->appendMaterial();
    soft->m_kLST = 1;
    cloth->generateBendingConstraints(2, soft);
    cloth->setTotalMass(btScalar(0.2));
    cloth->m_cfg.piterations = 4;
    cloth->m_cfg.kDF = 1;
    cloth->m_cfg.kKHR = 1;                  // hardness against what does not move; 0.1 sinks in
    cloth->m_cfg.collisions = btSoftBody::fCollision::SDF_RS;
    cloth->getCollisionShape()->setMargin(btScalar(0.002));
    world.addSoftBody(cloth);

    std::vector<double> ms;
    for (int i = 0; i < steps; i++) {
        const double start = cpu();
        world.stepSimulation(btScalar(1.0 / 60), 0);
        info.m_sparsesdf.GarbageCollect();
        ms.push_back(1e3 * (cpu() - start));
    }
    FILE *out = std::fopen(argv[3], "wb");
    if (!out) return 1;
    for (int i = 0; i < cloth->m_nodes.size(); i++) {
        const btVector3 &p = cloth->m_nodes[i].m_x;
        const double     x[3] = {p.x(), p.y(), p.z()};
        if (std::fwrite(x, sizeof x, 1, out) != 1) return 1;
    }
    std::fclose(out);
    double sum = 0;
    for (double t : ms) sum += t;
    std::sort(ms.begin(), ms.end());
    std::printf("%.3f %.3f\n", ms[ms.size() / 2], sum / steps);
    world.removeSoftBody(cloth);
    delete cloth;
    world.removeRigidBody(&sphere);
    return 0;
}
