import sys; A=sys.argv[1:]; src,dst,w=A[0],A[1],A[2]; sys.argv=['x','--threads','2','--widths',w]
from train import *
net=Net(tuple(map(int,w.split(','))),True,'4'); net.load_state_dict(torch.load(src))
print(scores(net))
for m in net.modules():
    if isinstance(m,nn.BatchNorm2d): m.reset_running_stats(); m.momentum=None
net.train()
with torch.no_grad():
    o=torch.randperm(len(g))[:24000]
    for i in range(0,len(o),32): fwd(net,g[o[i:i+32]])
net.eval(); print('precise', scores(net))
v=np.mean([loss(fwd(net,vg[i:i+200]),vf[i:i+200]/0.05).item() for i in range(0,len(vg),200)]) if 0 else None
torch.save(net.state_dict(),dst)
